"""The picture of a run: ways, robots, goals and their estimates at three times, beside one another."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from fleet.course import Course, shown_times_s
from fleet.panel import ESTIMATE, GOAL, Panel, View
from fleet.summary import Summary
from fleet.verdict_table import verdict_line
from protocol.scenario import Scenario

PANEL_IN = 4.2
"""Width of a panel; its height follows from the shown rectangle."""
GAP_IN, LEFT_IN, RIGHT_IN, TOP_IN, BOTTOM_IN = 0.3, 0.6, 0.15, 1.0, 0.95
DOTS_PER_INCH = 150
WIDEST_TEXT = 100.0
"""Font size in points times letters an inch that still fits."""
LEAST_ASPECT, MOST_ASPECT = 0.6, 1.4
"""A flatter or higher rectangle is filled up, so that the panels stay readable."""
INK = "0.25"


def draw_paths(scenario: Scenario, course: Course, summary: Summary, path: Path | BinaryIO) -> None:
    """Draw a run into a PNG file.

    Each panel shows the ways driven until its time, every robot as the disc of its body with its safety
    margin and a tip for its heading, the goals, and the goals as they were estimated at that time. Where the
    observers of a robot are of different opinions, all their estimates are drawn faintly.

    Args:
        scenario: what was run.
        course: what happened; before its first truth, the start is drawn.
        summary: how it ended.
        path: the file to write, or one that is open.

    Raises:
        OSError: the file cannot be written.
    """
    poses = course.poses() or {r.id: np.array([(0.0, *r.start_state()[:3])]) for r in scenario.robots}
    times_s = shown_times_s(course.end_s)
    view = _view(scenario, poses)
    figure, all_axes = _figure(len(times_s), view)
    for axes, time_s in zip(all_axes, times_s, strict=True):
        axes.set_title(f"t = {time_s:.1f} s", fontsize=10, color=INK)
        Panel(axes, view, scenario).draw(poses, course.estimates(time_s), time_s)
    estimated = any(course.estimates(time_s) for time_s in times_s)
    _explain(figure, summary, scenario.step_s, estimated=estimated)
    figure.savefig(path, format="png")


def _view(scenario: Scenario, poses: Mapping[str, NDArray[np.float64]]) -> View:
    """The rectangle of all ways and goals with the discs around them, not too flat and not too high."""
    goals = [(r.goal.x_m, r.goal.y_m) for r in scenario.robots]
    points = np.vstack([goals, *(rows[:, 1:3] for rows in poses.values())])
    reach_m = max(r.radius_m for r in scenario.robots) + scenario.safety_margin_m
    margin_m = 1.1 * reach_m + 0.04 * float(np.ptp(points, axis=0).max())
    low, high = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    width_m, height_m = high - low
    grown = np.array([max(width_m, height_m / MOST_ASPECT), max(height_m, width_m * LEAST_ASPECT)])
    low, high = (low + high - grown) / 2.0, (low + high + grown) / 2.0
    return View(low[0], high[0], low[1], high[1], points_per_m=PANEL_IN * 72.0 / grown[0])


def _figure(columns: int, view: View) -> tuple[Figure, list[Axes]]:
    """Axes of exactly the wanted size in m and on paper, with room for the titles and the legend."""
    height_in = PANEL_IN * (view.y_max_m - view.y_min_m) / (view.x_max_m - view.x_min_m)
    size_in = (
        LEFT_IN + columns * PANEL_IN + (columns - 1) * GAP_IN + RIGHT_IN,
        BOTTOM_IN + height_in + TOP_IN,
    )
    figure = Figure(figsize=size_in, dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    all_axes = []
    for column in range(columns):
        left_in = LEFT_IN + column * (PANEL_IN + GAP_IN)
        axes = figure.add_axes(
            (left_in / size_in[0], BOTTOM_IN / size_in[1], PANEL_IN / size_in[0], height_in / size_in[1])
        )
        axes.set(xlim=(view.x_min_m, view.x_max_m), ylim=(view.y_min_m, view.y_max_m), aspect="equal")
        axes.set_xlabel("x in m", fontsize=9, color=INK, labelpad=2)
        axes.tick_params(labelsize=8, colors=INK, labelleft=column == 0, length=3)
        axes.grid(color="0.92", linewidth=0.6)
        axes.set_axisbelow(True)
        for spine in axes.spines.values():
            spine.set_color("0.7")
        all_axes.append(axes)
    all_axes[0].set_ylabel("y in m", fontsize=9, color=INK, labelpad=2)
    return figure, all_axes


def _explain(figure: Figure, summary: Summary, step_s: float, *, estimated: bool) -> None:
    """The title, what came of the run, and the meaning of the marks."""
    width_in, height_in = figure.get_size_inches()
    left = LEFT_IN / width_in
    title = f"Scenario {summary.scenario}, goals: {summary.goals}"
    result = verdict_line(summary, step_s)
    for text, below_top_in, largest_font, weight in (
        (title, 0.3, 14.0, "bold"),
        (result, 0.58, 10.0, "normal"),
    ):
        figure.text(
            *(left, 1.0 - below_top_in / height_in),
            text,
            fontsize=min(largest_font, WIDEST_TEXT * width_in / len(text)),
            fontweight=weight,
            va="center",
        )
    entries: dict[str, Any] = {
        "way driven": Line2D([], [], color="0.4", linewidth=1.8),
        "robot with safety margin; tip: heading": (
            legend_mark("o", 14, "none", edge="0.6"),
            legend_mark("o", 10, "0.4"),
        ),
        "goal": legend_mark(GOAL, 11, "0.4"),
    }
    if estimated:
        entries["estimated goal"] = (
            Line2D([], [], color="0.4", linewidth=0.9, linestyle=(0, (4, 2))),
            legend_mark(ESTIMATE, 7, "white", edge="0.4", edge_width=1.4),
        )
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="lower left",
        bbox_to_anchor=(left, 0.12 / height_in),
        borderaxespad=0.0,
        borderpad=0.0,
        ncols=len(entries) if len(figure.axes) > 1 else 2,
        frameon=False,
        fontsize=9,
        handlelength=2.6,
        columnspacing=2.4,
    )


def legend_mark(
    marker: str, size: float, face: str, *, edge: str = "none", edge_width: float = 0.8
) -> Line2D:
    """A mark as a legend shows it; size and width in points."""
    return Line2D(
        [],
        [],
        linestyle="none",
        marker=marker,
        markersize=size,
        markerfacecolor=face,
        markeredgecolor=edge,
        markeredgewidth=edge_width,
    )
