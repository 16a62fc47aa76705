"""The bus alone: from the observations of a step to all its commands, with robots that do not think."""

import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import zenoh
from rich.table import Table

from fleet.bench.crossings import circle
from fleet.bench.durations import Distribution
from fleet.bench.settings import Settings
from fleet.bench.stars import Protection, star
from fleet.bench.watch import Watch
from fleet.record.report_file import Record
from fleet.record.tables import new_table, number
from fleet.run.processes import Processes, ProcessFailedError
from protocol.keys import Keys
from protocol.messages import PublicScene
from world.bus import Bus
from world.inbox import Inbox
from world.world import World

RUN = "bench"
EPOCH = 0
LOOK_S = 0.1
LOST_S = 5.0
"""A round that lasts longer has lost a message."""


class BusRow(Record):
    """Rounds with one number of robots, each in a process of its own."""

    robots: int
    protection: str
    """What keeps robots from each other, and the link; as the table names it."""
    rounds: int
    wall: Distribution
    """From the first observation put until the last command is there: both ways, packing and checking of
    messages, and the waiting for a core included."""


def measure(settings: Settings, watch: Watch) -> Iterator[BusRow]:
    """One row for each number of robots and each protection."""
    for robots in settings.robots:
        for protection in Protection:
            yield _row(robots, protection, settings.rounds, watch)


def _row(robots: int, protection: Protection, rounds: int, watch: Watch) -> BusRow:
    scenario, keys = circle(robots), Keys(RUN)
    scene = PublicScene(epoch=EPOCH, scene=scenario.scene(with_goals=False))
    observations = World(scenario, seed=0, epoch=EPOCH).observations()
    inbox = Inbox(observations)
    durations_ms = []
    with (
        tempfile.TemporaryDirectory(prefix="unspoken-bench-") as directory,
        Processes(Path(directory)) as processes,
    ):
        bus_star = star(protection, Path(directory), keys, list(observations))
        with zenoh.open(bus_star.world.to_zenoh()) as session:
            bus = Bus(session, keys, scene, tuple(observations), inbox)
            for robot in observations:
                settings = {"robot": robot, "run": RUN, "connect": bus_star.connect}
                processes.start(f"echo-{robot}", "fleet.bench.echo", settings | bus_star.proofs[robot])
            _wait_for_all(robots, inbox, processes, watch)
            for step in range(rounds):
                watch.tell(f"bus: {robots} robots, {protection}, round {step + 1}")
                now = {robot: each.model_copy(update={"step": step}) for robot, each in observations.items()}
                inbox.begin_step()
                begin_s = time.perf_counter()
                bus.publish_observations(now)
                gather(set(now), inbox)
                durations_ms.append(1e3 * (time.perf_counter() - begin_s))
    return BusRow(
        robots=robots, protection=protection.value, rounds=rounds, wall=Distribution.of(durations_ms)
    )


def _wait_for_all(robots: int, inbox: Inbox, processes: Processes, watch: Watch) -> None:
    while (present := len(inbox.take(LOOK_S).present)) < robots:
        watch.tell(f"bus: {present} of {robots} robots are there")
        if ended := processes.ended():
            raise ProcessFailedError("\n".join(ended.values()))


def gather(awaited: set[str], inbox: Inbox) -> None:
    """Return when a command of each of these robots is there.

    Raises:
        ProcessFailedError: one is missing after ``LOST_S``.
    """
    until_s = time.monotonic() + LOST_S
    while awaited:
        awaited -= {robot for robot, _ in inbox.take(until_s - time.monotonic()).commands}
        if awaited and time.monotonic() >= until_s:
            raise ProcessFailedError(
                f"the bus lost a message: no answer of robot {', '.join(sorted(awaited))} within {LOST_S:g} s"
            )


def table(rows: Iterable[BusRow]) -> Table:
    """One row a number of robots and protection."""
    result = new_table(
        "Bus alone: a step's observations out, all its commands back",
        "Protection",
        "Robots",
        "Rounds",
        "Wall ms\nmedian",
        "\np99",
        "\nmax",
    )
    for row in rows:
        wall = row.wall
        numbers = map(number, (wall.median_ms, wall.p99_ms, wall.max_ms))
        result.add_row(row.protection, str(row.robots), str(row.rounds), *numbers)
    return result
