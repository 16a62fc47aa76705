"""The world's process: a session around a run, and signals that end it."""

import secrets
from contextlib import closing
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import structlog
import zenoh

from chassis.process import on_wish_to_end
from chassis.watching import watch_port
from protocol.keys import BENCH_NAME, Keys
from protocol.messages import PublicScene
from protocol.scenario import Scenario
from protocol.session import SessionSettings, reason_of, receive_on_threads
from world.access import Access, most_sessions
from world.bus import Bus
from world.clock import Clock, LockStep, RealTime
from world.health import WorldHealth
from world.inbox import Inbox
from world.run import Run
from world.world import World

FAREWELL_S = 10.0
"""How long a reader of the truth may take to see the verdict and leave; seconds, on a very busy machine."""


class ExitStatus(IntEnum):
    """How a world ends, and with it a run."""

    ARRIVED = 0
    ENDED_OTHERWISE = 1
    WRONG_USAGE = 2
    FAILED = 3


class ClockKind(StrEnum):
    """The choice of a clock."""

    LOCKSTEP = "lockstep"
    REALTIME = "realtime"


@dataclass(frozen=True)
class WorldOptions:
    """What a world process is told at its start."""

    scenario: Scenario
    access: Access
    run: str
    clock: ClockKind
    seed: int
    exchange_goals: bool
    await_reader: bool
    start_timeout_s: float
    answer_timeout_s: float
    watch_port: int | None = None


class EndpointError(Exception):
    """The endpoint cannot be opened; the text says why and what to do."""


def run_world(options: WorldOptions) -> ExitStatus:
    """Hold one run, from the opening of the session to the verdict.

    SIGINT and SIGTERM end it with the verdict "interrupted". After the verdict the session stays open until
    the readers of the truth have left, or for ``FAREWELL_S``.

    Raises:
        AccessError: who may connect is not said as it must be.
        EndpointError: the endpoint cannot be opened.
        RobotsMissingError: robots were missing at the start.
        Refusal: the watch port cannot be used.
    """
    log = structlog.get_logger("world")
    scenario = options.scenario
    keys = Keys(options.run)
    epoch = secrets.randbits(63)
    world = World(scenario, seed=options.seed, epoch=epoch)
    scene = PublicScene(epoch=epoch, scene=scenario.scene(with_goals=options.exchange_goals))
    inbox = Inbox(world.robots)
    health = WorldHealth(world.robots)
    on_wish_to_end(inbox.interrupt)
    settings = options.access.session(keys, world.robots, log)
    receive_on_threads(most_sessions(world.robots))
    with (
        watch_port(health, options.watch_port),
        open_session(options.access.listen, settings) as session,
        closing(inbox),
    ):
        bus = Bus(session, keys, scene, world.robots, inbox)
        log.info(
            "world started",
            scenario=scenario.name,
            robots=len(world.robots),
            listen=options.access.listen,
            run=options.run,
            clock=options.clock.value,
            seed=options.seed,
            exchange_goals=options.exchange_goals,
            epoch=epoch,
        )
        health.up()  # for robots: whoever is started now finds it
        run = Run(world, _clock(options), inbox, bus, log, health)
        readers = (BENCH_NAME,) if options.await_reader else ()
        run.wait_for_robots(options.start_timeout_s, readers)
        verdict = run.drive().verdict
        health.ends()
        bus.wait_for_readers(FAREWELL_S)
    return ExitStatus.ARRIVED if verdict == "arrived" else ExitStatus.ENDED_OTHERWISE


def _clock(options: WorldOptions) -> Clock:
    if options.clock is ClockKind.REALTIME:
        return RealTime(options.scenario.step_s)
    return LockStep(options.answer_timeout_s)


def open_session(listen: str, settings: SessionSettings) -> zenoh.Session:
    """The session at which robots connect.

    Raises:
        EndpointError: it cannot be opened.
    """
    try:
        return zenoh.open(settings.to_zenoh())
    except zenoh.ZError as error:
        raise EndpointError(
            f"the endpoint {listen} cannot be opened: {reason_of(error)}. If another world listens there, "
            "end it or choose another endpoint with --listen, such as tcp/127.0.0.1:7448."
        ) from error
