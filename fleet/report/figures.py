"""The publication's four box plots: a row per method, a box per measure, every scenario as a dot."""

import io
import math
from base64 import b64encode
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from fleet.report.data import (
    DRIVEN,
    DURATION,
    ROBOT_DRIVEN,
    ROBOT_DURATION,
    SMALLEST_DISTANCE,
    SOURCE,
    Level,
    Measure,
    cpu_time,
    published,
)
from protocol.scenario import Scenario

FAR = 1.5
"""Robots that never come nearer than so many of the largest safety distance do not meet."""
DOTS_PER_INCH = 150
WIDTH_IN, ROW_IN, AROUND_IN, LEGEND_LINE_IN = 7.2, 0.36, 1.05, 0.2
"""Of a figure, of the row of one box, of title and axis, and of a line of the legend."""
GAP = 0.55
"""Between methods, in rows."""
INK, FRAME, RED = "0.25", "0.7", "#c1121f"
COLOURS = ("#8ecae6", "#a7d49b", "#ffd166")
"""Of the boxes: the first two as light as the publication's blue and green."""
WHISKER = {"color": INK, "linewidth": 0.9}
DOT = {"marker": "o", "markersize": 3.2, "color": INK, "markeredgewidth": 0.0, "alpha": 0.6}
BEYOND = {**DOT, "marker": ">", "markersize": 4.5}
COLLISION = {"marker": "X", "markersize": 6.5, "color": RED, "mec": "white", "mew": 0.5, "alpha": 0.9}
PUBLISHED = {"marker": "D", "markersize": 5.5, "color": "white", "mec": "black", "mew": 1.2, "zorder": 5}
GOLDEN = 0.6180339887498949
"""Multiples of it fill an interval evenly: dots are spread by it, the same way each time."""


class Picture(NamedTuple):
    """A picture of the page, which is a file of its own too."""

    file: str
    """Its name."""
    png: bytes
    alternative: str
    """What it shows, in words."""

    @property
    def source(self) -> str:
        """The picture as an address that holds it."""
        return f"data:image/png;base64,{b64encode(self.png).decode()}"


@dataclass(frozen=True)
class Chart:
    """Box plots of one or several measures at one level of noise."""

    level: Level
    title: str
    axis: str
    """What the numbers are, with their unit."""
    boxes: Mapping[str, Measure]
    """By what to call them; a box each in the row of each method."""
    mark: str = f"median of {SOURCE}"
    """What the publication's marks are."""
    apart: bool = False
    """Whether each measure has an axis of its own."""
    line: tuple[float, str] | None = None
    """A limit in red, and what it is."""
    most: float = math.inf
    """Where the axis ends; what lies beyond is marked there."""
    logarithmic: bool = False

    def png(self) -> bytes:
        """The picture; the same chart always gives the same bytes."""
        png = io.BytesIO()
        self.figure().savefig(png, format="png")
        return png.getvalue()

    def figure(self) -> Figure:
        """Boxes, dots and marks, with a legend of those that there are."""
        groups = [[name] for name in self.boxes] if self.apart else [list(self.boxes)]
        figure = Figure(dpi=DOTS_PER_INCH, facecolor="white", layout="constrained")
        FigureCanvasAgg(figure)
        entries: dict[str, Any] = {}
        all_axes = figure.subplots(1, len(groups), sharey=True, squeeze=False)[0]
        for column, (axes, names) in enumerate(zip(all_axes, groups, strict=True)):
            unit = self.boxes[names[0]].unit
            self._style(axes, len(names), f"in {unit} {names[0]}" if self.apart else self.axis)
            for row, name in enumerate(names):
                self._draw(axes, name, row, len(names), COLOURS[column + row])
            handles, labels = axes.get_legend_handles_labels()
            entries |= dict(zip(labels, handles, strict=True))
        entries = dict(sorted(entries.items(), key=lambda entry: entry[0] not in self.boxes))
        figure.suptitle(self.title, x=0.012, ha="left", fontsize=11, fontweight="bold")
        rows = len(self.level.methods) * (len(groups[0]) + GAP)
        lines = -(-len(entries) // 2)
        figure.set_size_inches(WIDTH_IN, AROUND_IN + ROW_IN * rows + LEGEND_LINE_IN * lines)
        if entries:
            handles, labels = list(entries.values()), list(entries)
            figure.legend(handles, labels, loc="outside lower left", ncols=2, frameon=False, fontsize=8.5)
        return figure

    def alternative(self) -> str:
        """What the chart shows, in words: its medians."""
        parts = []
        for name, measure in self.boxes.items():
            medians = self.level.values(measure).median().dropna()
            shown = ", ".join(f"{method} {significant(value)}" for method, value in medians.items())
            parts.append(f"{name}: {shown or 'no values'}")
        return f"{self.title}: box plots of {self.axis}. Medians: {'; '.join(parts)}."

    def _draw(self, axes: Axes, name: str, row: int, rows: int, colour: str) -> None:
        """One measure of all methods, in its row of each."""
        measure = self.boxes[name]
        values = self.level.values(measure)
        collided = self.level.any("collided")
        places = {m: index * (rows + GAP) + GAP / 2 + row + 0.5 for index, m in enumerate(self.level.methods)}
        columns = {method: values[method].dropna() for method in self.level.methods}
        axes.boxplot(
            [columns[method].to_numpy() for method in places],
            positions=list(places.values()),
            widths=0.72,
            orientation="horizontal",
            manage_ticks=False,
            showfliers=False,
            patch_artist=True,
            boxprops={"facecolor": colour, "edgecolor": INK, "linewidth": 0.9},
            medianprops={"color": "black", "linewidth": 2.0},
            whiskerprops=WHISKER,
            capprops=WHISKER,
            label=name if rows > 1 else None,
            zorder=2,
        )
        for method, place in places.items():
            x = columns[method]
            spread = ((np.arange(len(x)) * GOLDEN) % 1.0 - 0.5) * 0.6
            y = pd.Series(place + spread, x.index)
            hit = collided[method].loc[x.index]
            beyond = (x > self.most) & ~hit
            _mark(axes, "one scenario", DOT, x[~hit & ~beyond], y)
            _mark(axes, "one further right", BEYOND, x[beyond].clip(upper=self.most), y)
            _mark(axes, "scenario with a collision", COLLISION, x[hit], y)
            if (known := published(method, measure.column)) is not None:
                _mark(axes, self.mark, PUBLISHED, pd.Series([known]), pd.Series([place]))
        if self.line is not None:
            axes.axvline(self.line[0], color=RED, linewidth=1.2, zorder=1, label=self.line[1])
        if (values > self.most).to_numpy().any():
            axes.set_xlim(right=self.most + 0.02 * (self.most - axes.get_xlim()[0]))

    def _style(self, axes: Axes, rows: int, label: str) -> None:
        step = rows + GAP
        methods = self.level.methods
        axes.set_ylim(len(methods) * step, 0.0)
        ticks = [(index + 0.5) * step for index in range(len(methods))]
        axes.set_yticks(ticks, [f"{method}\n{_arrived(self.level, method)}" for method in methods])
        axes.tick_params(axis="y", length=0, labelsize=9)
        axes.tick_params(axis="x", labelsize=9, colors=INK, length=3)
        if self.logarithmic:
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlabel(label, fontsize=9, color=INK, labelpad=3)
        axes.grid(axis="x", color="0.9", linewidth=0.6)
        for index in range(1, len(methods)):
            axes.axhline(index * step, color="0.85", linewidth=0.6, zorder=0)
        axes.set_axisbelow(True)
        axes.spines[:].set_color(FRAME)


def _mark(
    axes: Axes, label: str, style: Mapping[str, Any], x: "pd.Series[float]", y: "pd.Series[float]"
) -> None:
    """Marks at those places that are in ``x``, and an entry of the legend if there are any."""
    if len(x):
        axes.plot(x, y[x.index], linestyle="none", label=label, **{"zorder": 4, **style})


def _arrived(level: Level, method: str) -> str:
    arrived = level.runs["all_arrived"][level.runs["method"] == method]
    of = "" if arrived.all() else f" of {len(arrived)}"
    return f"all arrived in {arrived.sum()}{of} {'run' if len(arrived) == 1 else 'runs'}"


def charts(level: Level, scenarios: Collection[Scenario]) -> dict[str, Chart]:
    """The charts of a level of noise, at which these scenarios were driven, by a short name for files."""
    collision_m = collision_distance_m(scenarios)
    safe_m = max(2.0 * (r.radius_m + each.safety_margin_m) for each in scenarios for r in each.robots)
    return {
        "duration": Chart(
            level,
            "How long it took until all had arrived",
            "duration in s",
            {
                "until all robots had arrived": DURATION,
                "until one robot had, on average": ROBOT_DURATION,
            },
        ),
        "driven": Chart(
            level,
            "How far they drove",
            "distance driven in m",
            {"by all robots together": DRIVEN, "by one robot, on average": ROBOT_DRIVEN},
            apart=True,
        ),
        "distance": Chart(
            level,
            "How near two robots came",
            "smallest distance of two centres in m",
            {"smallest distance": SMALLEST_DISTANCE},
            mark=f"smallest of all scenarios of {SOURCE}",
            line=None if collision_m is None else (collision_m, f"collision below {collision_m:.2f} m"),
            most=FAR * safe_m,
        ),
        "times": Chart(
            level,
            "What a decision costs",
            "CPU time of one robot in one step in ms, median of a run",
            {
                "planning": cpu_time("plan", "p50"),
                "joint prediction": cpu_time("predict", "p50"),
                "estimating goals": cpu_time("estimate", "p50"),
            },
            mark=f"median of {SOURCE}: wall-clock means, other computer",
            logarithmic=True,
        ),
    }


def collision_distance_m(scenarios: Iterable[Scenario]) -> float | None:
    """Centres nearer than this have collided; None without pairs, or if it is not the same for all pairs."""
    distances_m = {
        round(one.radius_m + other.radius_m, 9)
        for scenario in scenarios
        for one, other in combinations(scenario.robots, 2)
    }
    return distances_m.pop() if len(distances_m) == 1 else None


def significant(value: float) -> str:
    """A number with the digits that matter."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
