"""What the figures should be, and whether they are."""

from collections.abc import Sequence
from typing import Literal

from rich.table import Table

from fleet.bench.figures import Figures
from fleet.record.report_file import Record
from fleet.record.tables import new_table, number

PREDICTION_P99_MS = {8: 10.0, 16: 25.0, 32: 100.0}
"""By number of robots."""


class Target(Record):
    """One figure and its bound."""

    what: str
    unit: str
    measured: float | None
    """The worst of the figures that it is about; None: not measured."""
    bound: Literal["at most", "at least"]
    limit: float
    met: bool | None
    """None: not measured."""


def judge(figures: Figures) -> tuple[Target, ...]:
    """Every target."""
    return (*_of_decisions(figures), *_of_the_solver(figures), *_of_processes(figures))


def _of_decisions(figures: Figures) -> Sequence[Target]:
    what, rows = "whole decision, 8a, CPU time", [row for row in figures.decision if row.scenario == "8a"]
    return (
        _at_most(f"{what}, median", 6.0, "ms", [row.later.cpu.median_ms for row in rows]),
        _at_most(f"{what}, p99", 25.0, "ms", [row.later.cpu.p99_ms for row in rows]),
        _at_most(f"{what}, first from a standing start", 250.0, "ms", [row.first.cpu.max_ms for row in rows]),
    )


def _of_the_solver(figures: Figures) -> Sequence[Target]:
    crossings = [row for row in figures.prediction if row.scenario == "random"]
    of_8 = [row for row in crossings if row.robots == 8]
    against = [row for row in figures.comparison if row.scenario == "8a"]
    alike = [row for row in figures.comparison if row.same_minimum]
    what, faster = "joint prediction", "joint prediction, 8a, against the reference"
    return (
        *(
            _at_most(
                f"{what}, random crossings of {robots}, CPU time, p99",
                limit_ms,
                "ms",
                [row.later.cpu.p99_ms for row in crossings if row.robots == robots],
            )
            for robots, limit_ms in PREDICTION_P99_MS.items()
        ),
        _at_least(f"{faster}, medians", 100.0, "times faster", [row.times_faster_median for row in against]),
        _at_least(f"{faster}, p99", 100.0, "times faster", [row.times_faster_p99 for row in against]),
        _at_most(
            "cost of a closed loop, off the reference in the same minimum",
            0.1,
            "%",
            [abs(row.cost_difference_percent) for row in alike],
        ),
        _at_most(
            "random crossings of 8, too close as driven", 1e-3, "m", [row.driven_shortfall_m for row in of_8]
        ),
        _at_most(
            "random crossings of 8, too close as predicted",
            1e-3,
            "m",
            [row.predicted_shortfall_m for row in of_8],
        ),
        _at_most("random crossings of 8, unsolved", 0.0, "problems", [row.unsolved for row in of_8]),
    )


def _of_processes(figures: Figures) -> Sequence[Target]:
    runs = [row for row in figures.runs if row.scenario == "8a"]
    lockstep = [row for row in runs if row.clock == "lockstep"]
    realtime = [row for row in runs if row.clock == "realtime"]
    alone = [row for row in figures.startup if row.together == 1]
    empty = [row for row in figures.compiling if row.cache == "empty"]
    what = "8a in real time"
    return (
        _at_least("8a in lock-step", 10.0, "steps a second", [row.steps_per_s for row in lockstep]),
        _at_most(f"{what}, deadline misses", 1.0, "%", [row.deadline_misses_percent for row in realtime]),
        _at_most(f"{what}, collisions", 0.0, "pairs", [row.collisions for row in realtime]),
        _at_most(f"{what}, not arrived", 0.0, "robots", [row.not_arrived for row in realtime]),
        _at_most("an agent's process, resident", 250.0, "MiB", [row.agent_resident_mib for row in runs]),
        _at_most("an agent's process, ready after its start", 3.0, "s", [row.ready_s for row in alone]),
        _at_most("compiling from nothing, CPU time", 60.0, "s", [row.cpu_s for row in empty]),
    )


def _at_most(what: str, limit: float, unit: str, values: Sequence[float]) -> Target:
    worst = max(values, default=None)
    met = None if worst is None else worst <= limit
    return Target(what=what, unit=unit, measured=worst, bound="at most", limit=limit, met=met)


def _at_least(what: str, limit: float, unit: str, values: Sequence[float]) -> Target:
    worst = min(values, default=None)
    met = None if worst is None else worst >= limit
    return Target(what=what, unit=unit, measured=worst, bound="at least", limit=limit, met=met)


def table(targets: Sequence[Target]) -> Table:
    """One row a target."""
    result = new_table("Targets", "What", "Measured", "Target", "Met")
    for target in targets:
        sign = "≤" if target.bound == "at most" else "≥"
        met = {True: "[green]yes[/]", False: "[red]no[/]", None: "–"}[target.met]
        result.add_row(target.what, number(target.measured), f"{sign} {target.limit:g} {target.unit}", met)
    return result
