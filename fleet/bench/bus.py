"""The bus alone: from the observations of a step to all its commands, with robots that do not think."""

import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, Self

import zenoh

from chassis.refusal import ExitStatus, Refusal
from fleet.bench.loops import circle
from fleet.bench.measuring import Cell, Distribution, Progress, Row, Settings
from fleet.keys.authority import LOCAL_HOSTS, Device, folder_of
from fleet.keys.folders import create
from fleet.run.launch import Logins
from fleet.run.processes import Processes
from protocol.identity import load_device_keys
from protocol.keys import WORLD_NAME, Keys
from protocol.messages import PublicScene
from protocol.policy import access_control, rights_of
from protocol.session import SessionSettings, world_session
from world.bus import Bus, Inbox
from world.world import World

RUN = "bench"
LOOK_S = 0.05
LOST_S = 5.0
"""A round that lasts longer has lost a message."""
VALID_DAYS = 1


class Protection(StrEnum):
    """What protects a bus, and over which link; as the table names it."""

    NONE = "socket, open"
    PASSWORDS = "socket, policy by passwords"
    NONE_TCP = "TCP, open"
    CERTIFICATES = "TLS, policy by certificates"


class Star(NamedTuple):
    """A world's session that is yet to be opened, and how robots reach it."""

    world: SessionSettings
    endpoint: str
    proofs: Mapping[str, dict[str, str]]
    """By robot, the settings of its process that prove who it is."""


def star(protection: Protection, directory: Path, keys: Keys, robots: list[str]) -> Star:
    """A bus that nobody has opened yet.

    Args:
        protection: of it.
        directory: for its socket, passwords or keys.
        keys: of the run.
        robots: their ids.
    """
    rights, open_to_all = rights_of(keys, robots), {robot: dict[str, str]() for robot in robots}
    endpoint = f"unixsock-stream/{directory}/world.sock"
    if protection in (Protection.NONE_TCP, Protection.CERTIFICATES):
        with closing(socket.create_server(("127.0.0.1", 0))) as free:
            port = free.getsockname()[1]
        endpoint = f"{'tls' if protection is Protection.CERTIFICATES else 'tcp'}/127.0.0.1:{port}"
    if protection is Protection.PASSWORDS:
        logins = Logins(directory, robots)
        users = Path(logins.of_world()["users"])
        world = world_session(endpoint, access_control(rights, "usernames"), users)
        return Star(world, endpoint, {robot: logins.of_robot(robot) for robot in robots})
    if protection is Protection.CERTIFICATES:
        folder, now = directory / "keys", datetime.now(UTC)
        devices = [Device(WORLD_NAME, LOCAL_HOSTS), *map(Device, robots)]
        create(folder, devices, now, VALID_DAYS, VALID_DAYS + 1)
        own = load_device_keys(folder / folder_of(WORLD_NAME), now)
        world = world_session(endpoint, access_control(rights, "cert_common_names"), own)
        return Star(world, endpoint, {robot: {"keys": str(folder / folder_of(robot))} for robot in robots})
    return Star(world_session(endpoint), endpoint, open_to_all)


class BusRow(Row):
    """Rounds with one number of robots, each in a process of its own."""

    title = "Bus alone: a step's observations out, all its commands back"
    headers = "Protection|Robots|Rounds|Wall ms\nmedian|\np99|\nmax"

    robots: int
    protection: str
    rounds: int
    wall: Distribution
    """From the first observation put until the last command is there: both ways, packing and checking of
    messages, and the waiting for a core included."""

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """One row for each number of robots and each protection."""
        for robots in settings.robots:
            for protection in Protection:
                wall = Distribution.of(_rounds_ms(robots, protection, settings.rounds, progress))
                yield cls(robots=robots, protection=protection, rounds=settings.rounds, wall=wall)

    def lines(self) -> Iterable[Iterable[Cell]]:
        """Wall-clock time alone."""
        wall = self.wall
        yield self.protection, self.robots, self.rounds, wall.median_ms, wall.p99_ms, wall.max_ms


def _rounds_ms(robots: int, protection: Protection, rounds: int, progress: Progress) -> list[float]:
    scenario, keys = circle(robots), Keys(RUN)
    scene = PublicScene(epoch=0, scene=scenario.scene(with_goals=False))
    observations = World(scenario, seed=0, epoch=0).observations()
    inbox, durations_ms = Inbox(observations), []
    with TemporaryDirectory(prefix="unspoken-bench-") as directory, Processes(Path(directory)) as processes:
        bus_star = star(protection, Path(directory), keys, list(observations))
        with zenoh.open(bus_star.world.to_zenoh()) as session:
            bus = Bus(session, keys, scene, tuple(observations), inbox)
            for robot, proof in bus_star.proofs.items():
                options = {"robot": robot, "run": RUN, "connect": bus_star.endpoint, **proof}
                processes.start(f"echo-{robot}", "fleet.bench.echo", options)
            await_robots(
                robots, inbox, processes, lambda: progress.begin(f"bus: waiting for {robots} robots")
            )
            for step in range(rounds):
                progress.begin(f"bus: {robots} robots, {protection}, round {step + 1}")
                now = {robot: each.model_copy(update={"step": step}) for robot, each in observations.items()}
                inbox.begin_step()
                begin_s = time.perf_counter()
                bus.publish_observations(now)
                gather(set(now), inbox)
                durations_ms.append(1e3 * (time.perf_counter() - begin_s))
    return durations_ms


def await_robots(count: int, inbox: Inbox, processes: Processes, beat: Callable[[], None]) -> None:
    """Return when so many robots are present.

    Args:
        count: of robots.
        inbox: of the world.
        processes: of the robots.
        beat: called every ``LOOK_S``.

    Raises:
        Refusal: a process has ended.
    """
    while len(inbox.take(LOOK_S).present) < count:
        beat()
        if ended := processes.ended():
            raise Refusal("\n".join(ended.values()), ExitStatus.FAILED)


def gather(awaited: set[str], inbox: Inbox) -> None:
    """Return when a command of each of these robots is there.

    Raises:
        Refusal: one is missing after ``LOST_S``.
    """
    until_s = time.monotonic() + LOST_S
    while awaited:
        awaited -= {robot for robot, _ in inbox.take(until_s - time.monotonic()).commands}
        if awaited and time.monotonic() >= until_s:
            raise Refusal(
                f"the bus lost a message: no answer of robot {', '.join(sorted(awaited))} within "
                f"{LOST_S:g} s",
                ExitStatus.FAILED,
            )
