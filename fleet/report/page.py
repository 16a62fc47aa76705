"""The page of a report, with its tables: everything in one file, without scripts and without the network."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import NamedTuple

import pandas as pd
from jinja2 import Environment, StrictUndefined

from fleet.record.encounters import DistanceQuantiles, pooled
from fleet.report.data import (
    DURATION,
    MEASURES,
    PHASES,
    RESAMPLES,
    ROBOT_DURATION,
    SEED,
    SMALLEST_DISTANCE,
    SOURCE,
    Data,
    Estimate,
    Level,
    Measure,
    compare,
    cpu_time,
    median,
    median_with_unfinished,
    publication,
    published,
)
from fleet.report.figures import Picture, charts, collision_distance_m, significant

PREFIX = "report-"
"""Of all files of a report but the page."""
DASH = "–"


class Page(NamedTuple):
    """A page, and what its reader must know first."""

    html: str
    pictures: Sequence[Picture]
    remarks: Sequence[str]


class WorstRun(NamedTuple):
    """One of the worst runs as the page shows it."""

    name: str
    """Of its files, without their suffix."""
    title: str
    why: str
    command: str
    """What repeats it."""
    scenario: str
    """The text of a file, with its noise."""
    picture: Picture | None = None
    remarks: Sequence[str] = ()


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


class Section(NamedTuple):
    """All methods at one level of noise."""

    title: str
    pictures: Sequence[Picture]
    tables: Sequence[Table]
    details: Sequence[Table]
    """Long ones, shown on demand."""


def compose(data: Data, worst: Sequence[WorstRun]) -> Page:
    """The whole page, with these of the worst runs."""
    sections = [_section(data, level) for level in data.levels]
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    warnings = remarks(data)
    html = environment.from_string(_text("page.html")).render(
        title=f"Evaluation of {data.evaluation.suite}",
        style=_text("page.css"),
        facts=facts(data),
        remarks=warnings,
        overview=[noise_sweep(data.levels)] if len(sections) > 1 else [],
        levels=sections,
        worst=worst,
        resamples=RESAMPLES,
        seed=SEED,
        source=SOURCE,
        sizes_differ=collision_distance_m(data.evaluation.scenarios.values()) is None,
        durations_of_8a=durations_of_8a(data),
    )
    pictures = [picture for section in sections for picture in section.pictures]
    return Page(html, pictures + [run.picture for run in worst if run.picture is not None], warnings)


def _text(name: str) -> str:
    return files("fleet.report").joinpath(name).read_text(encoding="utf-8")


def _section(data: Data, level: Level) -> Section:
    several = len(data.evaluation.noise) > 1
    suffix = f"-{level.noise}" if several else ""
    planned = Counter[str](key.method for key in data.runs if key.noise == level.noise)
    compared = data.against in level.methods and len(level.methods) > 1
    return Section(
        title=f"Noise: {level.noise}" if several else "Results",
        pictures=[
            Picture(f"{PREFIX}{name}{suffix}.png", chart.png(), chart.alternative())
            for name, chart in charts(level, data.evaluation.scenarios.values()).items()
        ],
        tables=[
            medians(level),
            *([comparisons(level, data.against)] if compared else []),
            endings(level, planned),
            encounters(level),
            timings(level),
        ],
        details=[scenario_by_scenario(level, data.against)],
    )


def facts(data: Data) -> dict[str, str]:
    """What was run, where, when and by what."""
    evaluation, machine = data.evaluation, data.evaluation.machine
    robots = sorted({len(scenario.robots) for scenario in evaluation.scenarios.values()})
    seeds = "0" if evaluation.seeds == 1 else f"0 to {evaluation.seeds - 1}"
    begun = evaluation.begun
    return {
        "Suite": f"{evaluation.suite}, scenarios: {len(evaluation.scenarios)}",
        "Robots": f"{robots[0]}" if len(robots) == 1 else f"{robots[0]} to {robots[-1]}",
        "Methods": ", ".join(evaluation.goals),
        "Solver": evaluation.solver,
        "Reserve": "kept" if evaluation.reserve else "not kept",
        "Noise": ", ".join(evaluation.noise),
        "Seeds": f"{seeds}, where anything is random",
        "Runs": f"{len(data.rows)} of {len(data.runs)}",
        "Begun": "not noted" if begun is None else f"{begun:%Y-%m-%d %H:%M %z}".strip(),
        "Version": f"unspoken {machine.version}" + (f", commit {machine.commit}" if machine.commit else ""),
        "Machine": f"{machine.cpu}, {machine.cores} cores",
        "System": f"{machine.system}, Python {machine.python}",
    }


def remarks(data: Data) -> list[str]:
    """What a reader must know before any figure."""
    said = []
    made = {row.key for row in data.rows}
    missing = [key for key in data.runs if key not in made]
    if missing:
        methods = _counted(data, [key.method for key in missing])
        said.append(
            f"Unfinished: {len(missing)} of {len(data.runs)} runs are missing ({methods}). The same "
            "`unspoken evaluate` command with the same --out makes them."
        )
    if unfinished := [row.method for row in data.rows if row.duration_s is None]:
        said.append(
            f"Not all robots arrived in {len(unfinished)} of {len(data.rows)} runs "
            f"({_counted(data, unfinished)}). Durations and distances driven are those of the others."
        )
    if (data.evaluation.machine.commit or "").endswith("+"):
        said.append("The sources had been changed since the commit that is named here.")
    return said


def _counted(data: Data, methods: Sequence[str]) -> str:
    counts = ((method, methods.count(method)) for method in data.evaluation.goals)
    return ", ".join(f"{method}: {count}" for method, count in counts if count)


def durations_of_8a(data: Data) -> list[str]:
    """How long scenario 8a took, which is the publication's own, and what that one reports."""
    known_s = publication()["scenario_8a"]["reported_duration_s"]
    return [
        f"{row.method} {row.duration_s:.1f} s (published: {known_s[row.method]:.1f} s)"
        for row in data.rows
        if row.scenario == "8a" and row.noise == "none" and row.duration_s and row.method in known_s
    ]


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


ENDINGS = {
    "with a collision": "collided",
    "deadlock": "deadlock",
    "out of time": "timeout",
    "failed": "failed",
    "fallbacks": "solver_failures",
    "commands clipped": "clipped_commands",
}
"""What is counted, and in which column."""


def endings(level: Level, planned: Mapping[str, int]) -> Table:
    """How the runs ended, of so many that were planned for each method, and how often a robot had no plan."""
    rows = {}
    for method in level.methods:
        runs = level.runs[level.runs["method"] == method]
        made, arrived = len(runs), int(runs["all_arrived"].sum())
        rows[method] = [
            Cell(str(made) if made == planned[method] else f"{made} of {planned[method]}"),
            Cell(str(arrived), bad=arrived < made),
        ]
        for column in ENDINGS.values():
            count, known = int(runs[column].sum()), published(method, column)
            small = [] if known is None else [f"published {known:.0f}"]
            rows[method].append(Cell(str(count), small, count > 0 and column != "clipped_commands"))
    return Table("How the runs ended", ("Method", "runs", "all arrived", *ENDINGS), rows)


def encounters(level: Level) -> Table:
    """How near robots came in each run, whether minds of pairs agreed, how often robots were held back."""
    rows = {}
    for method in level.methods:
        runs = level.runs[level.runs["method"] == method]
        cells = []
        for column in ("closest_to_collision", "closest_to_safety"):
            known = runs[column].dropna().to_numpy(dtype=float)
            quantiles = DistanceQuantiles.of(known) if len(known) else None
            for _, value in quantiles or [("", None)] * 4:
                cells.append(Cell(DASH if value is None else f"{value:.3f}"))
            if quantiles is not None and column == "closest_to_collision":
                cells[0] = cells[0]._replace(bad=quantiles.min < 1.0)
        sides = [
            (float(share), int(pair_steps))
            for share, pair_steps in zip(runs["side_disagreement"], runs["side_pair_steps"], strict=True)
            if not math.isnan(share)
        ]
        share = pooled(sides)
        of = [f"of {sum(pair_steps for _, pair_steps in sides)} pair-steps"]
        cells.append(Cell(DASH) if share is None else Cell(f"{share:.1%}", of))
        cells.append(Cell(f"{int(runs['interventions'].sum())}", [f"in {len(runs)} runs"]))
        rows[method] = cells
    return Table(
        "Smallest distance of each run, relative to the collision distance and to the safety distance of the "
        "pair: quantiles over runs; how often two robots predicted to pass on different sides",
        (
            "Method",
            *(
                f"{of}, {name}"
                for of in ("collision", "safety")
                for name in ("smallest", "1 %", "10 %", "median")
            ),
            "sides differ",
            "interventions",
        ),
        rows,
    )


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
