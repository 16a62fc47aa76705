"""The joint prediction alone: how long it takes, and whether it always finds a solution."""

from collections.abc import Iterable, Iterator

from rich.table import Table

from fleet.bench.closed_loop import Solved, TimedSolver, drive, shortfall_m
from fleet.bench.crossings import circle, random_crossing
from fleet.bench.durations import Times
from fleet.bench.settings import Settings
from fleet.bench.watch import Watch
from fleet.record.report_file import Record
from fleet.record.tables import new_table, number
from protocol.scenario import Scenario, load_scenario
from scenarios import find


class PredictionRow(Record):
    """Closed loops of one kind with one number of robots, by the real-time solver."""

    scenario: str
    """``8a``, ``circle`` or ``random``."""
    robots: int
    loops: int
    first: Times
    """First solves of the loops, from all cold starts."""
    later: Times
    """All others."""
    unsolved: int
    """Starts from which no solution was found, over all loops."""
    predicted_shortfall_m: float
    """By how much predicted robots came closer than their safety distance, at the worst."""
    driven_shortfall_m: float
    """The same of robots as they drove."""


def measure(settings: Settings, watch: Watch) -> Iterator[PredictionRow]:
    """One row for scenario 8a, then two for each number of robots: random crossings and the circle."""
    solver = TimedSolver("realtime")
    if 8 in settings.robots:
        yield _row("8a", [load_scenario(find("8a"))], solver, settings, watch)
    for robots in settings.robots:
        seeds = range(settings.seed, settings.seed + settings.crossings_of(robots))
        yield _row("random", (random_crossing(robots, seed) for seed in seeds), solver, settings, watch)
        yield _row("circle", [circle(robots)], solver, settings, watch)


def _row(
    name: str, scenarios: Iterable[Scenario], solver: TimedSolver, settings: Settings, watch: Watch
) -> PredictionRow:
    loops: list[list[Solved]] = []
    for scenario in scenarios:
        loops.append([])
        for solved in drive(scenario, solver, settings.steps):
            loops[-1].append(solved)
            watch.tell(f"prediction alone: {scenario.name}, step {len(loops[-1])}")
    every = [solved for loop in loops for solved in loop]
    return PredictionRow(
        scenario=name,
        robots=len(every[0].problem.states),
        loops=len(loops),
        first=Times.of(loop[0].duration for loop in loops),
        later=Times.of(solved.duration for loop in loops for solved in loop[1:]),
        unsolved=sum(solved.unsolved for solved in every),
        predicted_shortfall_m=max(solved.solution.violation_m for solved in every),
        driven_shortfall_m=max(map(shortfall_m, loops)),
    )


def table(rows: Iterable[PredictionRow]) -> Table:
    """Thread CPU time with wall-clock time beside it."""
    result = new_table(
        "Joint prediction alone, real-time solver",
        "Scenario",
        "Robots",
        "Loops",
        "CPU ms\nmedian",
        "\np99",
        "\nmax",
        "Wall ms\np99",
        "First\nCPU max",
        "Un-\nsolved",
        "Too close\npredicted m",
        "driven\nm",
    )
    for row in rows:
        cpu = row.later.cpu
        result.add_row(
            row.scenario,
            str(row.robots),
            str(row.loops),
            *map(number, (cpu.median_ms, cpu.p99_ms, cpu.max_ms, row.later.wall.p99_ms)),
            number(row.first.cpu.max_ms),
            str(row.unsolved),
            number(row.predicted_shortfall_m),
            number(row.driven_shortfall_m),
        )
    return result
