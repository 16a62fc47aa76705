"""The tables of a report, ready to be written: text in cells."""

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import NamedTuple

from fleet.evaluate.results import Row
from fleet.report import published, statistics
from fleet.report.measures import (
    DURATION,
    MEASURES,
    PHASES,
    ROBOT_DURATION,
    SMALLEST_DISTANCE,
    Group,
    Measure,
    all_arrived,
    cpu_time,
)
from fleet.report.statistics import Estimate

DASH = "–"


class Cell(NamedTuple):
    """What stands in a cell: the main thing, more in small lines beneath, and whether it is a defect."""

    text: str
    small: tuple[str, ...] = ()
    bad: bool = False


class Table(NamedTuple):
    """A table; the first cell of a row names it."""

    caption: str
    header: tuple[str, ...]
    rows: list[tuple[Cell, ...]]


def medians(groups: Sequence[Group]) -> Table:
    """Medians over scenarios with their intervals, the publication's beneath."""
    return Table(
        "Medians over scenarios, with 95 % intervals",
        ("Method", *(f"{measure.name} in {measure.unit}" for measure in MEASURES)),
        [(Cell(group.method), *(_median_cell(group, measure) for measure in MEASURES)) for group in groups],
    )


def _median_cell(group: Group, measure: Measure) -> Cell:
    values = list(group.by_scenario(measure).values())
    estimate = statistics.median(values)
    small = [] if estimate is None else _interval(estimate)
    if measure is SMALLEST_DISTANCE:
        if values:
            small.append(f"smallest {min(values):.3f}")
        known = published.smallest_distance_m(group.method)
        small += [] if known is None else [f"published smallest {known:.3f}"]
        return Cell(DASH if estimate is None else f"{estimate.value:.3f}", tuple(small))
    missing = len(group.unfinished)
    if missing and measure in (DURATION, ROBOT_DURATION):
        # Scenarios that were not finished are longest; the finished runs of their other seeds do not count.
        finished = [v for s, v in group.by_scenario(measure).items() if s not in group.unfinished]
        small.append(f"unfinished as longest: {_or_never(finished, missing)}")
    known = published.median_of(group.method, measure.column)
    small += [] if known is None else [f"published {known:.2f}"]
    return Cell(DASH if estimate is None else f"{estimate.value:.2f}", tuple(small))


def _or_never(finished: Sequence[float], missing: int) -> str:
    value = statistics.median_with_missing(finished, missing)
    return "never" if math.isinf(value) else f"{value:.2f}"


def comparisons(groups: Sequence[Group], reference: Group) -> Table:
    """Every other method beside the reference, in the same scenarios."""
    return Table(
        f"Beside {reference.method}: ratio of medians, then the median difference in a scenario, with 95 % "
        "intervals; in how many scenarios the figure is smaller, equal and larger",
        ("Method", *(measure.name for measure in MEASURES)),
        [
            (Cell(group.method), *(_comparison_cell(group, reference, measure) for measure in MEASURES))
            for group in groups
            if group is not reference
        ],
    )


def _comparison_cell(group: Group, reference: Group, measure: Measure) -> Cell:
    compared = statistics.compare(group.by_scenario(measure), reference.by_scenario(measure))
    if compared is None:
        return Cell(DASH)
    own = published.median_of(group.method, measure.column)
    theirs = published.median_of(reference.method, measure.column)
    small = _interval(compared.ratio, 3)
    if own is not None and theirs is not None:
        small.append(f"published {own / theirs:.2f}")
    digits = 3 if measure is SMALLEST_DISTANCE else 2
    between = _between(compared.difference, digits, sign=True)
    small.append(f"{_signed(compared.difference.value, digits)} {measure.unit}{between}")
    small.append(f"{compared.less} less, {compared.equal} equal, {compared.more} more")
    return Cell(f"{compared.ratio.value:.3f}", tuple(small))


def endings(groups: Sequence[Group], planned: Mapping[str, int]) -> Table:
    """How the runs ended, and how often a robot had no plan.

    Args:
        groups: the methods.
        planned: how many runs of each method there are to be.
    """
    rows = []
    for group in groups:
        made = len(group.rows)
        arrived = sum(all_arrived(row) for row in group.rows)
        collided = sum(bool(row.collisions) for row in group.rows)
        known_collided = published.collided(group.method)
        known_failures = published.solver_failures(group.method)
        rows.append(
            (
                Cell(group.method),
                Cell(str(made) if made == planned[group.method] else f"{made} of {planned[group.method]}"),
                Cell(str(arrived), bad=arrived < made),
                Cell(str(collided), _published(known_collided), collided > 0),
                *(
                    _count(sum(row.verdict == verdict for row in group.rows))
                    for verdict in ("deadlock", "timeout")
                ),
                _count(sum(row.failed for row in group.rows)),
                Cell(
                    str(_sum(group.rows, "solver_failures")),
                    _published(known_failures),
                    _sum(group.rows, "solver_failures") > 0,
                ),
                Cell(str(_sum(group.rows, "clipped_commands"))),
            )
        )
    return Table(
        "How the runs ended",
        (
            *("Method", "runs", "all arrived", "with a collision", "deadlock", "out of time", "failed"),
            *("fallbacks", "commands clipped"),
        ),
        rows,
    )


def _published(value: int | None) -> tuple[str, ...]:
    return () if value is None else (f"published {value}",)


def _count(count: int) -> Cell:
    return Cell(str(count), bad=count > 0)


def _sum(rows: Sequence[Row], column: str) -> int:
    return sum(getattr(row, column) or 0 for row in rows)


def timings(groups: Sequence[Group]) -> Table:
    """CPU times of decisions: of a typical scenario, and of the worst run."""
    rows = []
    for group in groups:
        cells = [Cell(group.method)]
        for phase in PHASES:
            for statistic in ("p50", "p99"):
                measure = cpu_time(phase, statistic)
                of_runs = [value for row in group.rows if (value := getattr(row, measure.column)) is not None]
                highest = (f"highest {_significant(max(of_runs))}",) if of_runs else ()
                cells.append(Cell(middle(list(group.by_scenario(measure).values())), highest))
        rows.append(tuple(cells))
    return Table(
        "CPU time of one robot's decision in ms: medians over scenarios",
        ("Method", *(f"{phase}, {statistic}" for phase in PHASES for statistic in ("p50", "p99"))),
        rows,
    )


def scenario_by_scenario(groups: Sequence[Group], reference: Group | None) -> Table:
    """The duration of each scenario with each method, and the difference from the reference."""
    robots = {row.scenario: row.robots for group in groups for row in group.rows}
    base = {} if reference is None else reference.by_scenario(DURATION)
    columns = [_durations(group, {} if group is reference else base) for group in groups]
    rows = [
        (Cell(scenario), Cell(str(count)), *(column(scenario) for column in columns))
        for scenario, count in robots.items()
    ]
    return Table(
        "Duration of each scenario in s"
        + ("" if reference is None else f", and how much longer than with {reference.method}"),
        ("Scenario", "robots", *(group.method for group in groups)),
        rows,
    )


def _durations(group: Group, base: Mapping[str, float]) -> Callable[[str], Cell]:
    """Writes the cell of a scenario in the column of a method."""
    values = group.by_scenario(DURATION)

    def cell(scenario: str) -> Cell:
        rows = [row for row in group.rows if row.scenario == scenario]
        if not rows:
            return Cell("missing")
        both = scenario in values and scenario in base
        small = [_signed(values[scenario] - base[scenario], 1)] if both else []
        harm = [_harm(row) for row in rows if _harm(row)]
        if harm:
            how = ", ".join(dict.fromkeys(harm))
            small.append(how if len(rows) == 1 else f"{how} in {len(harm)} of {len(rows)} runs")
        return Cell(f"{values[scenario]:.1f}" if scenario in values else DASH, tuple(small), bool(harm))

    return cell


def _harm(row: Row) -> str:
    """What went wrong in a run, in a word; nothing if nothing did."""
    if row.collisions:
        return "collision"
    return "" if all_arrived(row) else row.verdict


def noise_sweep(levels: Mapping[str, Sequence[Group]]) -> Table:
    """The median duration of each method at each level of noise, beside that at the first level."""
    first = next(iter(levels))
    base = {group.method: group.by_scenario(DURATION) for group in levels[first]}
    methods = dict.fromkeys(group.method for groups in levels.values() for group in groups)
    rows = []
    for method in methods:
        cells = [Cell(method)]
        for level, groups in levels.items():
            found = [group for group in groups if group.method == method]
            before = {} if level == first else base.get(method, {})
            cells.append(_level_cell(found[0], before) if found else Cell("missing"))
        rows.append(tuple(cells))
    return Table(
        f"Median duration in s by noise, and its ratio to that at {first!r} in the same scenarios",
        ("Method", *levels),
        rows,
    )


def _level_cell(group: Group, base: Mapping[str, float]) -> Cell:
    values = group.by_scenario(DURATION)
    small = []
    compared = statistics.compare(values, base)
    if compared is not None:
        small.append(f"{compared.ratio.value:.3f} times" + _between(compared.ratio, 3))
    collided = sum(bool(row.collisions) for row in group.rows)
    unfinished = sum(not all_arrived(row) for row in group.rows)
    if collided:
        small.append(f"{collided} of {len(group.rows)} runs with a collision")
    if unfinished:
        small.append(f"not all arrived in {unfinished} of {len(group.rows)} runs")
    text = f"{median(list(values.values())):.2f}" if values else DASH
    return Cell(text, tuple(small), bool(collided or unfinished))


def _interval(estimate: Estimate, digits: int = 2, *, sign: bool = False) -> list[str]:
    if estimate.low is None or estimate.high is None:
        return []
    ends = (_signed(end, digits) if sign else f"{end:.{digits}f}" for end in (estimate.low, estimate.high))
    return [" … ".join(ends)]


def _signed(value: float, digits: int) -> str:
    """With its sign, unless it is rounded to zero."""
    rounded = round(value, digits)
    return f"{rounded:+.{digits}f}" if rounded else f"{0.0:.{digits}f}"


def _between(estimate: Estimate, digits: int, *, sign: bool = False) -> str:
    return "".join(f" ({each})" for each in _interval(estimate, digits, sign=sign))


def middle(values: Sequence[float]) -> str:
    """The median of some values as text, with the digits that matter."""
    return _significant(median(values)) if values else DASH


def _significant(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
