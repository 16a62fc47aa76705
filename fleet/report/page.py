"""The page of a report: everything in one file, without scripts and without the network."""

from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from typing import NamedTuple

from jinja2 import Environment, StrictUndefined

from fleet.report import tables
from fleet.report.data import CONFIDENCE, RESAMPLES, SEED, SOURCE, Data, Level, publication
from fleet.report.figures import Picture, charts, collision_distance_m
from fleet.report.worst import WorstRun

PREFIX = "report-"
"""Of all files of a report but the page."""


class Page(NamedTuple):
    """A page, and what its reader must know first."""

    html: str
    pictures: Sequence[Picture]
    remarks: Sequence[str]


def compose(data: Data, worst: Sequence[WorstRun]) -> Page:
    """The whole page.

    Args:
        data: what it is about.
        worst: runs to show.
    """
    levels = [_level(data, level) for level in data.levels]
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    warnings = remarks(data)
    html = environment.from_string(_text("page.html")).render(
        title=f"Evaluation of {data.evaluation.suite}",
        style=_text("page.css"),
        facts=facts(data),
        remarks=warnings,
        overview=[tables.noise_sweep(data.levels)] if len(levels) > 1 else [],
        levels=levels,
        worst=worst,
        notes=notes(data),
    )
    pictures = [picture for level in levels for picture in level.pictures]
    return Page(html, pictures + [run.picture for run in worst if run.picture is not None], warnings)


class _Section(NamedTuple):
    """All methods at one level of noise."""

    title: str
    pictures: Sequence[Picture]
    tables: Sequence[tables.Table]
    details: Sequence[tables.Table]
    """Long ones, shown on demand."""


def _level(data: Data, level: Level) -> _Section:
    several = len(data.evaluation.noise) > 1
    suffix = f"-{level.noise}" if several else ""
    planned = Counter(key.method for key in data.runs if key.noise == level.noise)
    compared = data.against in level.methods and len(level.methods) > 1
    return _Section(
        title=f"Noise: {level.noise}" if several else "Results",
        pictures=[
            Picture(f"{PREFIX}{name}{suffix}.png", chart.png(), chart.alternative())
            for name, chart in charts(level, data.evaluation.scenarios.values()).items()
        ],
        tables=[
            tables.medians(level),
            *([tables.comparisons(level, data.against)] if compared else []),
            tables.endings(level, planned),
            tables.timings(level),
        ],
        details=[tables.scenario_by_scenario(level, data.against)],
    )


def _text(name: str) -> str:
    return files("fleet.report").joinpath(name).read_text(encoding="utf-8")


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


NOTES = (
    "A scenario counts as one value: with several seeds, the mean over its runs, or the smallest of its "
    "smallest distances. Medians and boxes are over these values.",
    "Durations and distances driven are known only of runs in which all robots arrived; “unfinished as "
    "longest” is the median if each scenario with a run that did not arrive, or failed, had taken longer "
    "than all others.",
    f"Intervals: {CONFIDENCE:.0%} percentile bootstrap over scenarios, {RESAMPLES} resamples, seed "
    f"{SEED}; in comparisons both methods are resampled together. They show how much the choice of "
    "scenarios matters, and nothing else.",
    "A fallback is a trajectory problem without solution; the robot then drives by its failure rule.",
    "CPU times are those of the thread that decides; runs may have been made side by side. The first "
    "decisions of a run are the slowest, so in a short run they are the 99th percentile.",
    "Boxes show the quartiles; whiskers reach to the last value within 1.5 times their distance.",
    f"Published figures are those of {SOURCE}, on forty scenarios and a computer of their own: "
    "trends can be compared, single values cannot.",
)


def notes(data: Data) -> list[str]:
    """How the figures are to be read."""
    said = list(NOTES)
    if collision_distance_m(data.evaluation.scenarios.values()) is None:
        said.append(
            "Bodies differ in size, so no line shows at which distance of centres two robots collide."
        )
    known_s = publication()["scenario_8a"]["reported_duration_s"]
    durations_of_8a = [
        f"{row.method} {row.duration_s:.1f} s (published: {known_s[row.method]:.1f} s)"
        for row in data.rows
        if row.scenario == "8a" and row.noise == "none" and row.duration_s and row.method in known_s
    ]
    if durations_of_8a:
        said.append(f"Scenario 8a, which is the publication's own: {', '.join(durations_of_8a)}.")
    return said
