"""Composes the page of an evaluation from its runs: pure, without files and without driving anything."""

from collections import Counter
from collections.abc import Sequence

from fleet.report import tables
from fleet.report.boxes import Chart
from fleet.report.charts import charts
from fleet.report.material import Material
from fleet.report.measures import Group
from fleet.report.page import Level, Page, Picture, WorstRun
from fleet.report.words import facts, notes, remarks

PREFIX = "report-"
"""Of all files of a report but the page."""


def compose(material: Material, worst: Sequence[WorstRun]) -> Page:
    """The whole page.

    Args:
        material: what it is about.
        worst: runs to show.
    """
    levels = material.levels
    return Page(
        title=f"Evaluation of {material.evaluation.suite}",
        facts=facts(material),
        remarks=remarks(material),
        overview=[tables.noise_sweep(levels)] if len(levels) > 1 else [],
        levels=[_level(material, noise, groups) for noise, groups in levels.items()],
        worst=worst,
        notes=notes(material),
    )


def _level(material: Material, noise: str, groups: list[Group]) -> Level:
    reference = next((group for group in groups if group.method == material.against), None)
    scenarios = material.evaluation.scenarios.values()
    planned = Counter(key.method for key in material.runs if key.noise == noise)
    suffix = f"-{noise}" if len(material.evaluation.noise) > 1 else ""
    compared = [] if reference is None or len(groups) == 1 else [tables.comparisons(groups, reference)]
    return Level(
        title="Results" if len(material.evaluation.noise) == 1 else f"Noise: {noise}",
        pictures=[
            Picture(f"{PREFIX}{name}{suffix}.png", chart.png(), alternative(chart))
            for name, chart in charts(groups, scenarios).items()
        ],
        tables=[
            tables.medians(groups),
            *compared,
            tables.endings(groups, planned),
            tables.timings(groups),
        ],
        details=[tables.scenario_by_scenario(groups, reference)],
    )


def alternative(chart: Chart) -> str:
    """What a chart shows, in words: its medians."""
    parts = []
    for series in chart.series:
        told = [
            f"{method} {tables.middle(list(values.values()))}"
            for method, values in series.values.items()
            if values
        ]
        parts.append(f"{series.label}: {', '.join(told) or 'no values'}")
    return f"{chart.title}: box plots of {chart.axis}. Medians: {'; '.join(parts)}."
