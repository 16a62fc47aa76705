"""From the start of an agent's process to its readiness, which is its presence on the bus."""

import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh
from rich.table import Table

from fleet.bench.crossings import circle
from fleet.bench.resident import agents, taken_by
from fleet.bench.settings import Settings
from fleet.bench.watch import Watch
from fleet.record.report_file import Record
from fleet.record.tables import new_table, number
from fleet.run.processes import Processes, ProcessFailedError
from protocol.keys import Keys
from protocol.messages import PublicScene
from protocol.scenario import Scenario, ScenarioRobot
from protocol.session import world_session
from world.bus import Bus
from world.inbox import Inbox

RUN = "bench"
LOOK_S = 0.05
TOGETHER = 8


class StartupRow(Record):
    """Agents with goals by inverse optimal control and the real-time solver, compiled before."""

    together: int
    """Agents that were started at the same time."""
    starts: int
    ready_s: float
    """Wall-clock time until all of them are on the bus: the longest of the starts."""
    cpu_s: float
    """Of one agent until then, at the most."""
    resident_mib: float
    """Of one agent then, at the most."""


def measure(settings: Settings, watch: Watch) -> Iterator[StartupRow]:
    """One row for an agent alone, one for several at once."""
    together = min(TOGETHER, max(settings.robots))
    yield _row(1, settings.starts, watch)
    yield _row(together, 1, watch)


def _row(together: int, starts: int, watch: Watch) -> StartupRow:
    begun = [_start(circle(together), watch) for _ in range(starts)]
    ready_s, cpu_s, resident_mib = (max(values) for values in zip(*begun, strict=True))
    return StartupRow(
        together=together, starts=starts, ready_s=ready_s, cpu_s=cpu_s, resident_mib=resident_mib
    )


def _start(scenario: Scenario, watch: Watch) -> tuple[float, float, float]:
    """Start one agent for each robot.

    Returns:
        Time until all are ready in s; CPU time in s and resident memory in MiB of one, at the most.
    """
    count = len(scenario.robots)
    with (
        tempfile.TemporaryDirectory(prefix="unspoken-bench-") as directory,
        Processes(Path(directory)) as processes,
    ):
        endpoint = f"unixsock-stream/{directory}/world.sock"
        with _waiting_world(scenario, endpoint) as inbox:
            begin_s = time.perf_counter()
            for robot in scenario.robots:
                processes.start(f"robot-{robot.id}", "agent", _robot_settings(robot, endpoint))
            while len(inbox.take(LOOK_S).present) < count:
                watch.tell(f"start-up of {count}: {time.perf_counter() - begin_s:.1f} s")
                if ended := processes.ended():
                    raise ProcessFailedError("\n".join(ended.values()))
            ready_s = time.perf_counter() - begin_s
            taken = [each for each in map(taken_by, agents()) if each is not None]
    return ready_s, max(each.cpu_s for each in taken), max(each.resident_mib for each in taken)


@contextmanager
def _waiting_world(scenario: Scenario, endpoint: str) -> Iterator[Inbox]:
    """A world that answers for its scene and never begins."""
    inbox = Inbox(robot.id for robot in scenario.robots)
    scene = PublicScene(epoch=0, scene=scenario.scene(with_goals=False))
    with zenoh.open(world_session(endpoint).to_zenoh()) as session:
        _bus = Bus(session, Keys(RUN), scene, (), inbox)
        yield inbox


def _robot_settings(robot: ScenarioRobot, endpoint: str) -> dict[str, str]:
    goal = robot.goal_pose()
    return {
        "robot": robot.id,
        "goal": f"{goal.x_m!r},{goal.y_m!r},{goal.heading_rad!r}",
        "connect": endpoint,
        "run": RUN,
        "goals": "ioc",
        "solver": "realtime",
    }


def table(rows: Iterable[StartupRow]) -> Table:
    """One row a number of agents at once."""
    result = new_table(
        "From the start of agents to readiness, everything compiled before",
        "Agents at once",
        "Starts",
        "Ready after s",
        "CPU s\nof one",
        "Resident MiB\nof one",
    )
    for row in rows:
        numbers = map(number, (row.ready_s, row.cpu_s, row.resident_mib))
        result.add_row(str(row.together), str(row.starts), *numbers)
    return result
