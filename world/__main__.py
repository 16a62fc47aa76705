"""``python -m world``: the command line of the world's process."""

from typing import Annotated

import typer

from chassis.process import end_with_parent, log_to_journal
from chassis.refusal import run as run_command
from chassis.refusal import said_by
from protocol.scenario import load_scenario
from scenarios import find
from world.access import Access, AccessError
from world.options import (
    InsecureOption,
    KeysOption,
    ListenOption,
    RunOption,
    StartTimeoutOption,
    UsersOption,
    WatchPortOption,
    seconds,
)
from world.process import ClockKind, EndpointError, ExitStatus, WorldOptions, run_world
from world.run import RobotsMissingError


def main(
    scenario: Annotated[
        str,
        typer.Option(
            envvar="UNSPOKEN_SCENARIO", help="Scenario file, or the name of a bundled one such as 8a."
        ),
    ],
    listen: ListenOption = "tcp/127.0.0.1:7447",
    users: UsersOption = None,
    keys: KeysOption = None,
    insecure: InsecureOption = False,
    run: RunOption = "run",
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
    start_timeout: StartTimeoutOption = 60.0,
    answer_timeout: Annotated[
        float,
        typer.Option(
            envvar="UNSPOKEN_ANSWER_TIMEOUT",
            callback=seconds,
            help="Seconds to wait for the commands of one step in lock-step.",
        ),
    ] = 120.0,
    watch_port: WatchPortOption = None,
) -> None:
    """Simulate and referee one run.

    Exit status: 0 all robots arrived without collision, 1 the run ended otherwise, 2 wrong usage, scenario,
    passwords or keys, 3 robots were missing at the start, or the endpoint or the watch port could not be
    opened.
    """
    end_with_parent()
    log_to_journal()
    loaded = load_scenario(find(scenario))
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
        with said_by("world"):
            status = run_world(options)
    except AccessError as error:
        typer.echo(f"world: {error}", err=True)
        raise typer.Exit(ExitStatus.WRONG_USAGE) from None
    except (EndpointError, RobotsMissingError) as error:
        typer.echo(f"world: {error}", err=True)
        raise typer.Exit(ExitStatus.FAILED) from None
    raise typer.Exit(status)


if __name__ == "__main__":
    run_command(main)
