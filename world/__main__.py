"""``python -m world``: the command line of the world's process."""

from pathlib import Path
from typing import Annotated

import typer

from protocol.keys import NAME_RULE, checked_name
from protocol.logs import log_to_journal
from protocol.scenario_file import ScenarioError, load_scenario
from protocol.signals import end_with_parent
from protocol.watch_port import HELP as WATCH_PORT_HELP
from protocol.watch_port import VARIABLE as WATCH_PORT
from protocol.watch_port import WatchPortError
from scenarios import find
from world.access import Access, AccessError
from world.process import ClockKind, EndpointError, ExitStatus, WorldOptions, run_world
from world.run import RobotsMissingError

LONGEST_WAIT_S = 86_400.0


def _run_name(value: str) -> str:
    try:
        return checked_name(value)
    except ValueError:
        raise typer.BadParameter(f"{value!r} is no name of a run: {NAME_RULE}") from None


def _seconds(value: float) -> float:
    if not 0.0 <= value <= LONGEST_WAIT_S:  # also refuses NaN
        raise typer.BadParameter(f"{value} found, 0 to {LONGEST_WAIT_S:g} seconds are expected")
    return value


def main(
    scenario: Annotated[
        str,
        typer.Option(
            envvar="UNSPOKEN_SCENARIO", help="Scenario file, or the name of a bundled one such as 8a."
        ),
    ],
    listen: Annotated[
        str, typer.Option(envvar="UNSPOKEN_LISTEN", help="Zenoh endpoint at which robots connect.")
    ] = "tcp/127.0.0.1:7447",
    users: Annotated[
        Path | None,
        typer.Option(
            envvar="UNSPOKEN_USERS",
            help="File of lines name:password, for every robot and @bench, which only you can read. With it, "
            "each may do what the policy grants it and nothing else.",
            show_default="none, and whoever connects may read and say anything",
        ),
    ] = None,
    keys: Annotated[
        Path | None,
        typer.Option(
            envvar="UNSPOKEN_KEYS",
            help="Folder with the world's keys, as 'unspoken keys' makes it, for an endpoint tls/…; instead "
            "of passwords.",
            show_default="none",
        ),
    ] = None,
    insecure: Annotated[
        bool,
        typer.Option(
            "--insecure",
            envvar="UNSPOKEN_INSECURE",
            help="Let other machines connect although nothing is encrypted.",
        ),
    ] = False,
    run: Annotated[
        str,
        typer.Option(
            envvar="UNSPOKEN_RUN", callback=_run_name, help="Name of the run, first part of all its keys."
        ),
    ] = "run",
    clock: Annotated[
        ClockKind,
        typer.Option(
            envvar="UNSPOKEN_CLOCK",
            help="Wait for every robot at every step, or publish one step every Δt.",
        ),
    ] = ClockKind.LOCKSTEP,
    seed: Annotated[
        int, typer.Option(envvar="UNSPOKEN_SEED", min=0, help="Of sensor noise and dropouts.")
    ] = 0,
    exchange_goals: Annotated[
        bool,
        typer.Option(
            "--exchange-goals", envvar="UNSPOKEN_EXCHANGE_GOALS", help="Tell every robot all goals."
        ),
    ] = False,
    await_reader: Annotated[
        bool,
        typer.Option(
            "--await-reader",
            envvar="UNSPOKEN_AWAIT_READER",
            help="Begin when the truth has a reader, too, so that it misses nothing.",
        ),
    ] = False,
    start_timeout: Annotated[
        float,
        typer.Option(
            envvar="UNSPOKEN_START_TIMEOUT",
            callback=_seconds,
            help="Seconds to wait for all robots at the start.",
        ),
    ] = 60.0,
    answer_timeout: Annotated[
        float,
        typer.Option(
            envvar="UNSPOKEN_ANSWER_TIMEOUT",
            callback=_seconds,
            help="Seconds to wait for the commands of one step in lock-step.",
        ),
    ] = 120.0,
    watch_port: Annotated[
        int | None,
        typer.Option(envvar=WATCH_PORT, min=0, max=65535, help=WATCH_PORT_HELP, show_default="none"),
    ] = None,
) -> None:
    """Simulate and referee one run.

    Exit status: 0 all robots arrived without collision, 1 the run ended otherwise, 2 wrong usage, scenario,
    passwords or keys, 3 robots were missing at the start, or the endpoint or the watch port could not be
    opened.
    """
    end_with_parent()
    log_to_journal()
    try:
        loaded = load_scenario(find(scenario))
    except ScenarioError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(ExitStatus.WRONG_USAGE) from None
    access = Access(listen, users, keys, insecure)
    options = WorldOptions(
        loaded,
        access,
        run,
        clock,
        seed,
        exchange_goals,
        await_reader,
        start_timeout,
        answer_timeout,
        watch_port,
    )
    try:
        status = run_world(options)
    except AccessError as error:
        typer.echo(f"world: {error}", err=True)
        raise typer.Exit(ExitStatus.WRONG_USAGE) from None
    except (EndpointError, RobotsMissingError, WatchPortError) as error:
        typer.echo(f"world: {error}", err=True)
        raise typer.Exit(ExitStatus.FAILED) from None
    raise typer.Exit(status)


if __name__ == "__main__":
    typer.run(main)
