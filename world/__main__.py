"""``python -m world``: the world's process and its command line."""

import secrets
from contextlib import closing
from typing import Annotated

import structlog
import typer

from chassis.process import end_with_parent, log_to_journal, on_wish_to_end
from chassis.refusal import ExitStatus, said_by
from chassis.refusal import run as run_command
from chassis.watching import watch_port as open_watch_port
from protocol.keys import BENCH_NAME, Keys
from protocol.messages import PublicScene
from protocol.scenario import load_scenario
from protocol.session import receive_on_threads
from scenarios import find
from world.access import Access, most_sessions
from world.bus import Bus, open_session
from world.clock import ClockKind, LockStep, RealTime
from world.health import WorldHealth
from world.inbox import Inbox
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
from world.run import Run
from world.world import World


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
            help="Begin only once the truth has a reader, so that it misses nothing.",
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

    SIGINT and SIGTERM end it with the verdict "interrupted".

    Exit status: 0 all robots arrived without collision, 1 the run ended otherwise, 2 wrong usage, scenario,
    passwords or keys, 3 robots were missing at the start, or the endpoint or the watch port could not be
    opened.
    """
    end_with_parent()
    log_to_journal()
    log = structlog.get_logger("world")
    loaded = load_scenario(find(scenario))
    bus_keys, epoch = Keys(run), secrets.randbits(63)
    world = World(loaded, seed=seed, epoch=epoch)
    scene = PublicScene(epoch=epoch, scene=loaded.scene(with_goals=exchange_goals))
    inbox, health = Inbox(world.robots), WorldHealth(world.robots)
    on_wish_to_end(inbox.interrupt)
    receive_on_threads(most_sessions(world.robots))
    access = Access(listen, users, keys, insecure)
    with (
        said_by("world"),
        open_watch_port(health, watch_port),
        open_session(listen, access.session(bus_keys, world.robots, log)) as session,
        closing(inbox),
    ):
        bus = Bus(session, bus_keys, scene, world.robots, inbox)
        log.info(
            "world started",
            scenario=loaded.name,
            robots=len(world.robots),
            listen=listen,
            run=run,
            clock=clock.value,
            seed=seed,
            exchange_goals=exchange_goals,
            epoch=epoch,
        )
        health.up()  # for robots: whoever is started now finds it
        lasting = RealTime(loaded.step_s) if clock is ClockKind.REALTIME else LockStep(answer_timeout)
        driven = Run(world, lasting, inbox, bus, log, health)
        driven.wait_for_robots(start_timeout, (BENCH_NAME,) if await_reader else ())
        verdict = driven.drive().verdict
        health.ends()
        bus.wait_for_readers()
    if verdict != "arrived":
        raise typer.Exit(ExitStatus.UNMET)


if __name__ == "__main__":
    run_command(main)
