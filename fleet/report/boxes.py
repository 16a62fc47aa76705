"""Box plots of methods: a row a method, a box a measure, every scenario as a dot."""

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from fleet.record.picture import legend_mark

Values = NDArray[np.float64]

DOTS_PER_INCH = 150
WIDTH_IN, LEFT_IN, RIGHT_IN, TOP_IN, AXIS_IN, LEGEND_LINE_IN = 7.2, 2.15, 0.2, 0.4, 0.5, 0.22
SERIES_IN, GAP_IN = 0.36, 0.2
"""Height of the row of one box, and between methods."""
INK, RED = "0.25", "#c1121f"
COLOURS = ("#8ecae6", "#a7d49b", "#ffd166")
"""Of the boxes: the first two as light as the publication's blue and green."""
DOT, BEYOND, COLLISION, PUBLISHED = "o", ">", "X", "D"
EDGE = 1.2
"""Width of the edge of the publication's marks in points."""
GOLDEN = 0.6180339887498949
"""Multiples of it fill an interval evenly: dots are spread by it, the same way each time."""


@dataclass(frozen=True)
class Series:
    """One box in the row of each method.

    Attributes:
        label: what it is.
        values: by method and scenario.
        published: a figure of the publication, by method.
    """

    label: str
    values: Mapping[str, Mapping[str, float]]
    published: Mapping[str, float]


@dataclass(frozen=True)
class Chart:
    """A picture of some series.

    Attributes:
        title: what it shows.
        axis: what the numbers are, with their unit.
        methods: with what to say of each beneath its name; from top to bottom.
        series: one box each.
        collided: scenarios in which robots collided, by method.
        published: what the publication's marks are.
        line: a limit, and what it is.
        most: where the axis ends; what lies beyond is marked there.
        logarithmic: for what differs by orders of magnitude.
    """

    title: str
    axis: str
    methods: Mapping[str, str]
    series: Sequence[Series]
    collided: Mapping[str, set[str]]
    published: str
    line: tuple[float, str] | None = None
    most: float = math.inf
    logarithmic: bool = False

    def png(self) -> bytes:
        """The picture; the same chart always gives the same bytes."""
        rows_in = len(self.methods) * (SERIES_IN * len(self.series) + GAP_IN)
        entries = self._legend()
        columns = 2 if len(entries) > 1 else 1
        legend_in = LEGEND_LINE_IN * (-(-len(entries) // columns)) + 0.1
        height_in = TOP_IN + rows_in + AXIS_IN + legend_in
        figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DOTS_PER_INCH, facecolor="white")
        FigureCanvasAgg(figure)
        axes = figure.add_axes(
            (
                LEFT_IN / WIDTH_IN,
                (legend_in + AXIS_IN) / height_in,
                1.0 - (LEFT_IN + RIGHT_IN) / WIDTH_IN,
                rows_in / height_in,
            )
        )
        self._style(axes)
        self.draw(axes)
        figure.text(
            *(0.1 / WIDTH_IN, 1.0 - 0.2 / height_in), self.title, fontsize=11, fontweight="bold", va="center"
        )
        figure.legend(
            list(entries.values()),
            list(entries),
            loc="lower left",
            bbox_to_anchor=(0.1 / WIDTH_IN, 0.05 / height_in),
            borderaxespad=0.0,
            borderpad=0.0,
            ncols=columns,
            frameon=False,
            fontsize=8.5,
            handlelength=1.6,
        )
        png = io.BytesIO()
        figure.savefig(png, format="png")
        return png.getvalue()

    def draw(self, axes: Axes) -> None:
        """Draw all boxes, dots and marks into axes."""
        for number, series in enumerate(self.series):
            places = {method: self._place(index, number) for index, method in enumerate(self.methods)}
            shown = {method: series.values[method] for method in self.methods if series.values.get(method)}
            if shown:
                self._boxes(axes, [places[method] for method in shown], shown, COLOURS[number])
            for method, values in shown.items():
                self._dots(axes, places[method], values, self.collided.get(method, set()))
            for method in self.methods.keys() & series.published.keys():
                where = np.array([series.published[method]]), np.array([places[method]])
                _marks(axes, where, PUBLISHED, 5.5, "white", edge="black", edge_width=EDGE, zorder=5.0)
        if self.line is not None:
            axes.axvline(self.line[0], color=RED, linewidth=1.2, zorder=1)
        if self._reaches_beyond:
            left = axes.get_xlim()[0]
            axes.set_xlim(left, self.most + 0.02 * (self.most - left))

    @property
    def _reaches_beyond(self) -> bool:
        values = [
            each for series in self.series for values in series.values.values() for each in values.values()
        ]
        return any(value > self.most for value in values)

    def _place(self, method: int, series: int) -> float:
        height_in = len(self.series) * SERIES_IN + GAP_IN
        return method * height_in + GAP_IN / 2.0 + (series + 0.5) * SERIES_IN

    def _boxes(
        self,
        axes: Axes,
        places: Sequence[float],
        shown: Mapping[str, Mapping[str, float]],
        colour: str,
    ) -> None:
        axes.boxplot(
            [list(values.values()) for values in shown.values()],
            positions=places,
            widths=0.72 * SERIES_IN,
            orientation="horizontal",
            manage_ticks=False,
            showfliers=False,
            patch_artist=True,
            boxprops={"facecolor": colour, "edgecolor": INK, "linewidth": 0.9},
            medianprops={"color": "black", "linewidth": 2.0},
            whiskerprops={"color": INK, "linewidth": 0.9},
            capprops={"color": INK, "linewidth": 0.9},
            zorder=2,
        )

    def _dots(self, axes: Axes, place: float, values: Mapping[str, float], collided: set[str]) -> None:
        spread = ((np.arange(len(values)) * GOLDEN) % 1.0 - 0.5) * 0.6 * SERIES_IN
        x, y = np.array(list(values.values())), np.asarray(place + spread, dtype=np.float64)
        hit = np.array([scenario in collided for scenario in values])
        beyond = x > self.most
        usual = ~hit & ~beyond
        _marks(axes, (x[usual], y[usual]), DOT, 3.2, INK, alpha=0.45)
        _marks(axes, (x[beyond].clip(max=self.most), y[beyond]), BEYOND, 4.0, INK, alpha=0.45)
        _marks(axes, (x[hit], y[hit]), COLLISION, 6.0, RED, edge="white", alpha=0.9)

    def _style(self, axes: Axes) -> None:
        height = len(self.methods) * (len(self.series) * SERIES_IN + GAP_IN)
        step = height / len(self.methods)
        axes.set_ylim(height, 0.0)
        axes.set_yticks(
            [(index + 0.5) * step for index in range(len(self.methods))],
            [f"{method}\n{note}" if note else method for method, note in self.methods.items()],
        )
        axes.tick_params(axis="y", length=0, labelsize=9)
        axes.tick_params(axis="x", labelsize=9, colors=INK, length=3)
        if self.logarithmic:
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlabel(self.axis, fontsize=9, color=INK, labelpad=3)
        axes.grid(axis="x", color="0.9", linewidth=0.6)
        for index in range(1, len(self.methods)):
            axes.axhline(index * step, color="0.85", linewidth=0.6, zorder=0)
        axes.set_axisbelow(True)
        for spine in axes.spines.values():
            spine.set_color("0.7")

    def _legend(self) -> dict[str, Line2D | Patch]:
        entries: dict[str, Line2D | Patch] = {}
        if len(self.series) > 1:
            for series, colour in zip(self.series, COLOURS, strict=False):
                entries[series.label] = Patch(facecolor=colour, edgecolor=INK, linewidth=0.9)
        entries["one scenario"] = legend_mark(DOT, 3.5, INK)
        if self._reaches_beyond:
            entries["one further right"] = legend_mark(BEYOND, 4.5, INK)
        if any(self.collided.values()):
            entries["scenario with a collision"] = legend_mark(COLLISION, 6.5, RED)
        if any(series.published for series in self.series):
            entries[self.published] = legend_mark(PUBLISHED, 5.5, "white", edge="black", edge_width=EDGE)
        if self.line is not None:
            entries[self.line[1]] = Line2D([], [], color=RED, linewidth=1.2)
        return entries


def _marks(
    axes: Axes,
    places: tuple[Values, Values],
    marker: str,
    size: float,
    face: str,
    *,
    edge: str = "none",
    edge_width: float = 0.5,
    alpha: float = 1.0,
    zorder: float = 4.0,
) -> None:
    axes.plot(
        *places,
        linestyle="none",
        marker=marker,
        markersize=size,
        markerfacecolor=face,
        markeredgecolor=edge,
        markeredgewidth=edge_width,
        alpha=alpha,
        zorder=zorder,
    )
