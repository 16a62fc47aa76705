"""Runs of scenario 8a in real processes: how fast in lock-step, how punctual in real time."""

import tempfile
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path

from rich.table import Table

from fleet.bench.resident import agents, taken_by
from fleet.bench.settings import Settings
from fleet.bench.watch import Watch
from fleet.record.report_file import Record
from fleet.record.stream import BusMessage
from fleet.record.summary import Summary, Tally
from fleet.record.tables import new_table, number
from fleet.run.experiment import Experiment, prepare
from fleet.run.live import run_processes
from protocol.messages import Truth
from world.process import ClockKind

LOOK_STEPS = 10
"""The agents' memory is looked at every so many steps."""
LARGEST = {8: "8a", 4: "4-crossing", 2: "2-crossing"}
"""Of the bundled scenarios, one with a wanted number of robots is run."""


class RunRow(Record):
    """One run with goals by inverse optimal control; the bench listens, as in ``unspoken run``."""

    scenario: str
    clock: str
    robots: int
    verdict: str
    steps: int
    steps_per_s: float
    """From the first truth to the last."""
    deadline_misses: int
    deadline_misses_percent: float
    """Of all commands that were due."""
    collisions: int
    not_arrived: int
    """Robots."""
    unsolved: int
    """Problems, over all robots."""
    decide_p50_ms: float | None
    """Wall-clock time of a whole decision; with more processes than cores it holds the others' time too."""
    decide_p99_ms: float | None
    agent_resident_mib: float
    """Of the largest agent at any time of the run."""


def measure(settings: Settings, watch: Watch) -> Iterator[RunRow]:
    """One row a clock, in the largest of the bundled scenarios with a number of robots that is wanted."""
    for robots, name in LARGEST.items():
        if robots in settings.robots:
            for clock in ClockKind:
                experiment = prepare(
                    name, goals="ioc", solver="realtime", clock=clock.value, seed=0, policy=True
                )
                yield _run(experiment, watch)
            return


def _run(experiment: Experiment, watch: Watch) -> RunRow:
    tally, truths, times_ns, resident_mib = Tally(), 0, [], 0.0
    what = f"run in processes: {experiment.scenario.name}, {experiment.facts.clock}"
    watch.tell(f"{what}, starting")
    with tempfile.TemporaryDirectory(prefix="unspoken-bench-") as directory:
        stream = run_processes(experiment, Path(directory) / "logs", watch.interruption)
        with closing(stream):  # type: ignore[type-var]  # a generator, whose closing ends the processes
            for item in stream:
                if not isinstance(item, BusMessage):
                    continue
                tally.add(item.message)
                if isinstance(item.message, Truth):
                    watch.tell(f"{what}, step {item.message.step}")
                    times_ns.append(item.time_ns)
                    if truths % LOOK_STEPS == 0:
                        resident_mib = max(resident_mib, _largest_resident_mib())
                    truths += 1
    duration_s = 1e-9 * (times_ns[-1] - times_ns[0])
    return _row(tally.summary(experiment.facts), duration_s, resident_mib)


def _largest_resident_mib() -> float:
    return max((taken.resident_mib for taken in map(taken_by, agents()) if taken), default=0.0)


def _row(summary: Summary, duration_s: float, resident_mib: float) -> RunRow:
    robots = len(summary.robots)
    return RunRow(
        scenario=summary.scenario,
        clock=summary.clock,
        robots=robots,
        verdict=summary.verdict,
        steps=summary.steps,
        steps_per_s=summary.steps / duration_s,
        deadline_misses=summary.deadline_misses,
        deadline_misses_percent=100.0 * summary.deadline_misses / (robots * summary.steps),
        collisions=summary.collisions,
        not_arrived=sum(robot.arrived_s is None for robot in summary.robots),
        unsolved=summary.solver_failures,
        decide_p50_ms=summary.phases_ms.decide.p50,
        decide_p99_ms=summary.phases_ms.decide.p99,
        agent_resident_mib=resident_mib,
    )


def table(rows: Iterable[RunRow]) -> Table:
    """One row a run."""
    result = new_table(
        "Runs in real processes, goals by inverse optimal control",
        "Scenario",
        "Clock",
        "Robots",
        "Verdict",
        "Steps",
        "Steps\na second",
        "Deadline\nmisses",
        "in %",
        "Decide wall\nms, median",
        "\np99",
        "Un-\nsolved",
        "Largest\nagent MiB",
    )
    for row in rows:
        result.add_row(
            row.scenario,
            row.clock,
            str(row.robots),
            row.verdict,
            str(row.steps),
            number(row.steps_per_s),
            str(row.deadline_misses),
            number(row.deadline_misses_percent),
            number(row.decide_p50_ms),
            number(row.decide_p99_ms),
            str(row.unsolved),
            number(row.agent_resident_mib),
        )
    return result
