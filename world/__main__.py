"""``python -m world``: the world's process and its command line."""

import secrets
from contextlib import closing
from typing import Annotated

import typer
from pydantic import Field

from chassis.health import watch_port
from chassis.lean import structlog
from chassis.options import with_options
from chassis.process import end_with_parent, log_to_journal, on_wish_to_end
from chassis.refusal import ExitStatus, run, said_by
from protocol.keys import BENCH_NAME, Keys
from protocol.messages import PublicScene
from protocol.scenario import load_scenario
from protocol.session import receive_on_threads
from scenarios import find
from world.access import HostOptions, WaitS, most_sessions
from world.bus import Bus, Inbox, open_session
from world.clock import ClockKind, LockStep, RealTime
from world.health import WorldHealth
from world.run import Run
from world.world import World


class WorldOptions(HostOptions):
    """What the world's process is told at its start."""

    scenario: str = Field(description="Scenario file, or the name of a bundled one such as 8a.")
    clock: ClockKind = Field(
        ClockKind.LOCKSTEP, description="Wait for every robot at every step, or publish a step every Δt."
    )
    seed: int = Field(0, ge=0, description="Seed of sensor noise and dropouts.")
    exchange_goals: Annotated[bool, typer.Option("--exchange-goals")] = Field(
        False, description="Publish all goals to every robot."
    )
    await_reader: Annotated[bool, typer.Option("--await-reader")] = Field(
        False, description="Wait for a subscriber to the truth before starting, so that it misses nothing."
    )
    answer_timeout: WaitS = Field(
        120.0, description="Seconds to wait for the commands of one step in lock-step."
    )


@with_options(environment=True)
def main(options: WorldOptions) -> None:
    """Simulate and referee one run.

    SIGINT and SIGTERM end it with the verdict "interrupted".

    Exit status: 0 all robots arrived without collision, 1 the run ended otherwise, 2 invalid usage, scenario,
    passwords or keys, 3 robots were missing at the start, or the endpoint or the watch port could not be
    opened.
    """
    end_with_parent()
    log_to_journal()
    log = structlog.get_logger("world")
    scenario = load_scenario(find(options.scenario))
    keys, epoch = Keys(options.run), secrets.randbits(63)
    world = World(scenario, seed=options.seed, epoch=epoch)
    scene = PublicScene(epoch=epoch, scene=scenario.scene(with_goals=options.exchange_goals))
    inbox, health = Inbox(world.robots), WorldHealth(world.robots)
    on_wish_to_end(inbox.interrupt)
    receive_on_threads(most_sessions(world.robots))
    with (
        said_by("world"),
        watch_port(health, options.watch_port),
        open_session(options.listen, options.session(keys, world.robots, log)) as session,
        closing(inbox),
    ):
        bus = Bus(session, keys, scene, world.robots, inbox)
        log.info(
            "world started",
            scenario=scenario.name,
            robots=len(world.robots),
            epoch=epoch,
            **options.model_dump(mode="json", include={"listen", "run", "clock", "seed", "exchange_goals"}),
        )
        health.up()  # for robots: whoever is started now finds it
        in_real_time = options.clock is ClockKind.REALTIME
        clock = RealTime(scenario.step_s) if in_real_time else LockStep(options.answer_timeout)
        driven = Run(world, clock, inbox, bus, log, health)
        driven.wait_for_robots(options.start_timeout, (BENCH_NAME,) if options.await_reader else ())
        verdict = driven.drive().verdict
        health.ends()
        bus.wait_for_readers()
    if verdict != "arrived":
        raise typer.Exit(ExitStatus.UNMET)


if __name__ == "__main__":
    run(main)
