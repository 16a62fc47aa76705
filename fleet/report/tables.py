"""The tables of a report, ready to be written: text in cells."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from fleet.report.data import (
    DURATION,
    MEASURES,
    PHASES,
    ROBOT_DURATION,
    SMALLEST_DISTANCE,
    Estimate,
    Level,
    Measure,
    compare,
    cpu_time,
    median,
    median_with_unfinished,
    published,
)
from fleet.report.figures import significant

DASH = "–"


class Cell(NamedTuple):
    """What stands in a cell: the main thing, more in small lines beneath, and whether it is a defect."""

    text: str
    small: Sequence[str] = ()
    bad: bool = False


class Table(NamedTuple):
    """A table; its header begins with that of the names of rows."""

    caption: str
    header: Sequence[str]
    rows: Mapping[str, Sequence[Cell]]


def medians(level: Level) -> Table:
    """Medians over scenarios with their intervals, the publication's beneath."""
    return Table(
        "Medians over scenarios, with 95 % intervals",
        ("Method", *(f"{measure.name} in {measure.unit}" for measure in MEASURES)),
        {method: [_median_cell(level, method, measure) for measure in MEASURES] for method in level.methods},
    )


def _median_cell(level: Level, method: str, measure: Measure) -> Cell:
    values, known = level.values(measure)[method], published(method, measure.column)
    estimate = median(values)
    small = _interval(estimate)
    if measure is SMALLEST_DISTANCE:
        small += [] if estimate is None else [f"smallest {values.min():.3f}"]
        small += [] if known is None else [f"published smallest {known:.3f}"]
        return Cell(DASH if estimate is None else f"{estimate.value:.3f}", small)
    unfinished = level.any("unfinished")[method]
    if unfinished.any() and measure in (DURATION, ROBOT_DURATION):
        longest = median_with_unfinished(values, unfinished)
        small.append(f"unfinished as longest: {'never' if math.isinf(longest) else f'{longest:.2f}'}")
    small += [] if known is None else [f"published {known:.2f}"]
    return Cell(DASH if estimate is None else f"{estimate.value:.2f}", small)


def comparisons(level: Level, against: str) -> Table:
    """Every other method beside the reference, in the same scenarios."""
    return Table(
        f"Beside {against}: ratio of medians, then the median difference in a scenario, with 95 % intervals; "
        "in how many scenarios the figure is smaller, equal and larger",
        ("Method", *(measure.name for measure in MEASURES)),
        {
            method: [_comparison_cell(level, method, against, measure) for measure in MEASURES]
            for method in level.methods
            if method != against
        },
    )


def _comparison_cell(level: Level, method: str, against: str, measure: Measure) -> Cell:
    values = level.values(measure)
    compared = compare(values[method], values[against])
    if compared is None:
        return Cell(DASH)
    small = _interval(compared.ratio, 3)
    own, theirs = (published(each, measure.column) for each in (method, against))
    if measure is not SMALLEST_DISTANCE and own is not None and theirs is not None:
        small.append(f"published {own / theirs:.2f}")
    digits = 3 if measure is SMALLEST_DISTANCE else 2
    between = "".join(f" ({each})" for each in _interval(compared.difference, digits, sign=True))
    small.append(f"{_signed(compared.difference.value, digits)} {measure.unit}{between}")
    small.append(f"{compared.less} less, {compared.equal} equal, {compared.more} more")
    return Cell(f"{compared.ratio.value:.3f}", small)


def endings(level: Level, planned: Mapping[str, int]) -> Table:
    """How the runs ended, and how often a robot had no plan.

    Args:
        level: the runs.
        planned: how many runs of each method there are to be.
    """
    names = ("Method", "runs", "all arrived", "with a collision", "deadlock", "out of time", "failed")
    rows = {}
    for method in level.methods:
        runs = level.runs[level.runs["method"] == method]
        made = len(runs)
        arrived = int(runs["all_arrived"].sum())

        def count(column: str, runs: pd.DataFrame = runs, method: str = method) -> Cell:
            known, total = published(method, column), int(runs[column].sum())
            return Cell(str(total), [] if known is None else [f"published {known:.0f}"], total > 0)

        verdicts = runs["verdict"].value_counts()
        rows[method] = [
            Cell(str(made) if made == planned[method] else f"{made} of {planned[method]}"),
            Cell(str(arrived), bad=arrived < made),
            count("collided"),
            *(
                Cell(str(verdicts.get(verdict, 0)), bad=verdict in verdicts)
                for verdict in ("deadlock", "timeout", "failed")
            ),
            count("solver_failures"),
            count("clipped_commands")._replace(bad=False),
        ]
    return Table("How the runs ended", (*names, "fallbacks", "commands clipped"), rows)


def timings(level: Level) -> Table:
    """CPU times of decisions: of a typical scenario, and of the worst run."""
    measures = [cpu_time(phase, statistic) for phase in PHASES for statistic in ("p50", "p99")]
    medians_ms = {measure: level.values(measure).median() for measure in measures}
    highest_ms = level.runs.groupby("method")[[measure.column for measure in measures]].max()
    rows = {}
    for method in level.methods:
        rows[method] = [
            Cell(significant(medians_ms[measure][method]), [f"highest {significant(highest)}"])
            if not math.isnan(highest := highest_ms[measure.column][method])
            else Cell(DASH)
            for measure in measures
        ]
    return Table(
        "CPU time of one robot's decision in ms: medians over scenarios",
        ("Method", *(measure.name for measure in measures)),
        rows,
    )


def scenario_by_scenario(level: Level, against: str) -> Table:
    """The duration of each scenario with each method, and the difference from the reference."""
    values = level.values(DURATION)
    compared = against in level.methods
    rows = {}
    for scenario, runs in level.runs.groupby("scenario", sort=False):
        durations_s = {method: float(values[method].loc[str(scenario)]) for method in level.methods}
        base_s = durations_s[against] if compared else math.nan
        cells = [Cell(f"{runs['robots'].iloc[0]}")]
        for method in level.methods:
            longer_s = math.nan if method == against else durations_s[method] - base_s
            small = [] if math.isnan(longer_s) else [_signed(longer_s, 1)]
            cells.append(_duration_cell(durations_s[method], small, runs[runs["method"] == method]))
        rows[str(scenario)] = cells
    return Table(
        "Duration of each scenario in s" + (f", and how much longer than with {against}" if compared else ""),
        ("Scenario", "robots", *level.methods),
        rows,
    )


def _duration_cell(value: float, small: Sequence[str], runs: pd.DataFrame) -> Cell:
    """Args: the duration, lines beneath it, and the runs of this scenario with this method."""
    if runs.empty:
        return Cell("missing")
    unhappy = runs[runs["collided"] | runs["unfinished"]]
    harm = ["collision" if run.collided else str(run.verdict) for run in unhappy.itertuples()]
    how = ", ".join(dict.fromkeys(harm))
    lines = [how if len(runs) == 1 else f"{how} in {len(harm)} of {len(runs)} runs"] if harm else []
    return Cell(DASH if math.isnan(value) else f"{value:.1f}", [*small, *lines], bool(harm))


def noise_sweep(levels: Sequence[Level]) -> Table:
    """The median duration at each level of noise, beside that at the first level."""
    first, *_ = levels
    rows = {}
    for method in dict.fromkeys(method for level in levels for method in level.methods):
        rows[method] = [
            _level_cell(level, method, first) if method in level.methods else Cell("missing")
            for level in levels
        ]
    return Table(
        f"Median duration in s by noise, and its ratio to that at {first.noise!r} in the same scenarios",
        ("Method", *(level.noise for level in levels)),
        rows,
    )


def _level_cell(level: Level, method: str, first: Level) -> Cell:
    values = level.values(DURATION)[method]
    runs = level.runs[level.runs["method"] == method]
    small = []
    if level is not first and method in first.methods:
        compared = compare(values, first.values(DURATION)[method])
        if compared is not None:
            between = "".join(f" ({each})" for each in _interval(compared.ratio, 3))
            small.append(f"{compared.ratio.value:.3f} times{between}")
    collided, unfinished = int(runs["collided"].sum()), int(runs["unfinished"].sum())
    if collided:
        small.append(f"{collided} of {len(runs)} runs with a collision")
    if unfinished:
        small.append(f"not all arrived in {unfinished} of {len(runs)} runs")
    return Cell(f"{values.median():.2f}" if values.notna().any() else DASH, small)


def _interval(estimate: Estimate | None, digits: int = 2, *, sign: bool = False) -> list[str]:
    if estimate is None or estimate.low is None or estimate.high is None:
        return []
    ends = (_signed(end, digits) if sign else f"{end:.{digits}f}" for end in (estimate.low, estimate.high))
    return [" … ".join(ends)]


def _signed(value: float, digits: int) -> str:
    """With its sign, unless it is rounded to zero."""
    rounded = round(value, digits)
    return f"{rounded:+.{digits}f}" if rounded else f"{0.0:.{digits}f}"
