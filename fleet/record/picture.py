"""The picture of a run: paths, robots, goals and their estimates at three times, beside one another."""

import math
from array import array
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from fleet.record.encounters import LATE_STEPS
from fleet.record.summary import Summary, verdict_line
from protocol.messages import Message, Mind, PublicScene, Truth
from protocol.scenario import Scenario, ScenarioRobot

PUBLISHED_TIMES_S = (1.6, 3.0)
"""The publication's figure shows a run at these times and at its end."""
COLOURS = [to_hex(colour) for colour in mpl.color_sequences["petroff10"]]
"""Ten colours that stay distinct with impaired colour vision (Petroff 2021); more robots repeat them."""
GOAL, ESTIMATE = "*", "D"
DASHED = (0, (4, 2))
AGREEMENT_M = 0.01
"""Observers whose estimates differ by less agree."""
TIP_RADII = 1.4
"""How far the tip that shows the heading reaches from the centre, in radii of the body."""
SMALLEST_FONT, LARGEST_FONT = 5.0, 9.0
PANEL_IN = 4.2
"""Width of a panel; its height follows from the shown rectangle."""
GAP_IN, LEFT_IN, RIGHT_IN, TOP_IN, BOTTOM_IN = 0.3, 0.6, 0.15, 1.0, 0.95
DOTS_PER_INCH = 150
WIDEST_TEXT = 100.0
"""Font size in points times letters an inch that still fits."""
LEAST_ASPECT, MOST_ASPECT = 0.6, 1.4
"""A flatter or higher rectangle is filled up, so that the panels stay readable."""
INK = "0.25"
STYLE: dict[Any, Any] = {  # matplotlib types the keys as a literal of all that there are
    "axes.axisbelow": True,
    "axes.edgecolor": "0.7",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelpad": 2,
    "axes.labelsize": 9,
    "axes.titlecolor": INK,
    "axes.titlesize": 10,
    "grid.color": "0.92",
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "xtick.color": INK,
    "xtick.labelsize": 8,
    "xtick.major.size": 3,
    "ytick.color": INK,
    "ytick.labelsize": 8,
    "ytick.major.size": 3,
}

Points = list[tuple[float, float]]
Pose = NDArray[np.float64]
"""x and y in m and heading in rad."""
Poses = NDArray[np.float64]
Estimates = Mapping[str, Sequence[tuple[float, float]]]


def shown_times_s(end_s: float) -> tuple[float, ...]:
    """The times at which a run is shown: those of the publication and the end; thirds of a short run."""
    if end_s >= 1.5 * PUBLISHED_TIMES_S[-1]:
        return (*PUBLISHED_TIMES_S, end_s)
    return (end_s / 3.0, 2.0 * end_s / 3.0, end_s) if end_s > 0.0 else (end_s,)


class Course:
    """Gathers a run of a given Δt in s from its messages, as they come or from a recording.

    All poses are kept, 32 bytes a robot and step; of the estimates only those that may be shown.
    Where the world was started again in between, its last epoch is shown.
    """

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s
        self._begin(None)

    def _begin(self, epoch: int | None) -> None:
        self._epoch = epoch
        self._poses: defaultdict[str, array[float]] = defaultdict(lambda: array("d"))
        self._estimates: dict[int, defaultdict[str, Points]] = {}
        """By step and robot."""
        self.end_s = 0.0
        """Time of the newest truth, in s."""

    def add(self, message: Message) -> None:
        """Take a truth or a mind; other messages show nothing more."""
        if isinstance(message, PublicScene | Truth) and message.epoch != self._epoch:
            self._begin(message.epoch)
        if isinstance(message, Truth):
            self.end_s = message.time_s
            for name, robot in message.robots.items():
                state = robot.state
                self._poses[name].extend((message.time_s, state.x_m, state.y_m, state.heading_rad))
        elif isinstance(message, Mind) and message.estimates:
            estimates = self._estimates.setdefault(message.step, defaultdict(list))
            for name, goal in message.estimates.items():
                estimates[name].append((goal.x_m, goal.y_m))
            newest = max(self._estimates)
            for old in [step for step in self._estimates if step < newest - LATE_STEPS]:
                if not self._is_until(old, PUBLISHED_TIMES_S[-1]):
                    del self._estimates[old]

    def poses(self) -> dict[str, Poses]:
        """By robot: time in s, x and y in m, heading in rad at every step of its, shape (steps, 4)."""
        return {name: np.array(poses).reshape(-1, 4) for name, poses in self._poses.items()}

    def estimates(self, time_s: float) -> Estimates:
        """Goals as they were estimated at one of the shown times or, without any then, last before it.

        Returns:
            By robot: the estimate of every observer, x and y in m.
        """
        step = max((step for step in self._estimates if self._is_until(step, time_s)), default=None)
        return {} if step is None else self._estimates[step]

    def _is_until(self, step: int, time_s: float) -> bool:
        return step * self._step_s <= time_s + 1e-9


class View(NamedTuple):
    """The shown rectangle and its scale on paper."""

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float
    points_per_m: float


@dataclass(frozen=True)
class Panel:
    """Draws one instant of a run into axes."""

    axes: Axes
    view: View
    scenario: Scenario

    def draw(self, poses: Mapping[str, Poses], estimates: Estimates, time_s: float) -> None:
        """Draw everything as it was at a time.

        Args:
            poses: by robot, time in s, x and y in m and heading in rad, shape (steps, 4), in order of time.
            estimates: by robot, its goal as each observer estimated it, in m.
            time_s: the time.
        """
        past = {name: rows[rows[:, 0] <= time_s + 1e-9] for name, rows in poses.items()}
        present_s = max((rows[-1, 0] for rows in past.values() if len(rows)), default=0.0)
        for robot, colour in zip(self.scenario.robots, cycle(COLOURS), strict=False):
            rows = past.get(robot.id, np.empty((0, 4)))
            # A robot that has left the run before leaves only its path.
            pose = rows[-1, 1:] if len(rows) and rows[-1, 0] == present_s else None
            self.axes.plot(rows[:, 1], rows[:, 2], color=colour, lw=1.8, zorder=2)
            self.axes.plot(rows[:1, 1], rows[:1, 2], "o", ms=3.5, color=colour, zorder=2)
            goal = (robot.goal.x_m, robot.goal.y_m)
            height = _height(robot, pose, goal, 5.0)
            self.axes.plot(*goal, GOAL, ms=13, mfc=colour, mec="white", mew=0.8, zorder=height)
            if pose is not None:
                self._robot(robot, pose, colour)
                self._estimates(robot, pose, estimates.get(robot.id, ()), colour)

    def _robot(self, robot: ScenarioRobot, pose: Pose, colour: str) -> None:
        x_m, y_m, heading_rad = pose.tolist()
        radius_m = robot.radius_m
        safe_m = radius_m + self.scenario.safety_margin_m
        # The sides of the tip touch the disc as tangents.
        side_rad = math.acos(1.0 / TIP_RADII)
        angles_rad = heading_rad + np.array([-side_rad, 0.0, side_rad])
        reach_m = radius_m * np.array([[1.0], [TIP_RADII], [1.0]])
        tip = pose[:2] + reach_m * np.column_stack((np.cos(angles_rad), np.sin(angles_rad)))
        for patch in (
            Circle((x_m, y_m), safe_m, fill=False, edgecolor=colour, linewidth=0.7, zorder=3),
            Circle((x_m, y_m), radius_m, facecolor=colour, linewidth=0.0, zorder=3),
            Polygon(tip, facecolor=colour, linewidth=0.0, zorder=3),
        ):
            self.axes.add_patch(patch)
        self._name(robot, (x_m, y_m), colour)

    def _name(self, robot: ScenarioRobot, centre: tuple[float, float], colour: str) -> None:
        """The id inside the disc where it is readable there, else above it and inside the panel."""
        width_points = 2.0 * robot.radius_m * self.view.points_per_m
        font = min(LARGEST_FONT, 1.2 * width_points / max(2, len(robot.id)))
        inside = font >= SMALLEST_FONT
        place = (centre[0] - self.view.x_min_m) / (self.view.x_max_m - self.view.x_min_m)
        self.axes.annotate(
            robot.id,
            centre,
            xytext=(0.0, 0.0 if inside else width_points / 2.0 + 4.0),
            textcoords="offset points",
            ha="center" if inside or 0.2 < place < 0.8 else "left" if place <= 0.2 else "right",
            va="center_baseline" if inside else "bottom",
            fontsize=font if inside else SMALLEST_FONT + 1.0,
            fontweight="bold",
            color=_contrast(colour) if inside else colour,
            zorder=6,
            path_effects=[] if inside else [withStroke(linewidth=2.0, foreground="white")],
        )

    def _estimates(
        self, robot: ScenarioRobot, pose: Pose, goals: Sequence[tuple[float, float]], colour: str
    ) -> None:
        different: Points = []
        for goal in goals:
            if all(math.dist(goal, other) > AGREEMENT_M for other in different):
                different.append(goal)
        strength = 1.0 if len(different) <= 1 else 0.4
        for x_m, y_m in different:
            line = ((pose[0], x_m), (pose[1], y_m))
            self.axes.plot(*line, color=colour, lw=0.9, ls=DASHED, alpha=0.8 * strength, zorder=2.5)
            height = _height(robot, pose, (x_m, y_m), 4.0)
            mark: dict[str, Any] = {"ms": 6.5, "mfc": "white", "mec": colour, "mew": 1.5}
            self.axes.plot(x_m, y_m, ESTIMATE, **mark, alpha=strength, zorder=height)


def _height(robot: ScenarioRobot, pose: Pose | None, point: tuple[float, float], above: float) -> float:
    """Drawing order of a mark: above the robots, but beneath its own robot, whose name it would hide."""
    beneath = pose is not None and math.dist(point, pose[:2]) < robot.radius_m
    return 2.9 if beneath else above


def _contrast(colour: str) -> str:
    """Black or white, whichever is easier to read on a colour (luminance after Rec. 709)."""
    return "black" if float(np.dot(to_rgb(colour), (0.2126, 0.7152, 0.0722))) > 0.5 else "white"


def draw_paths(scenario: Scenario, course: Course, summary: Summary, path: Path | BinaryIO) -> None:
    """Draw a run into a PNG file.

    Each panel shows the paths driven until its time, every robot as the disc of its body with its safety
    margin and a tip for its heading, the goals, and the goals as they were estimated at that time. Where the
    observers of a robot do not agree, all their estimates are drawn faintly.

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
    with mpl.rc_context(STYLE):
        figure, panels = _figure(len(times_s), view)
        for axes, time_s in zip(panels, times_s, strict=True):
            axes.set(title=f"t = {time_s:.1f} s", xlabel="x in m")
            Panel(axes, view, scenario).draw(poses, course.estimates(time_s), time_s)
        panels[0].set_ylabel("y in m")
        estimated = any(course.estimates(time_s) for time_s in times_s)
        _explain(figure, summary, scenario.step_s, estimated=estimated)
        figure.savefig(path, format="png")


def _view(scenario: Scenario, poses: Mapping[str, Poses]) -> View:
    """The rectangle of all paths and goals with the discs around them, not too flat and not too high."""
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
    whole_in = BOTTOM_IN + height_in + TOP_IN
    width_in = LEFT_IN + columns * PANEL_IN + (columns - 1) * GAP_IN + RIGHT_IN
    figure = Figure(figsize=(width_in, whole_in), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    edges = {
        "left": LEFT_IN / width_in,
        "right": 1.0 - RIGHT_IN / width_in,
        "bottom": BOTTOM_IN / whole_in,
        "top": 1.0 - TOP_IN / whole_in,
        "wspace": GAP_IN / PANEL_IN,
    }
    shown = {"xlim": (view.x_min_m, view.x_max_m), "ylim": (view.y_min_m, view.y_max_m), "aspect": "equal"}
    panels = figure.subplots(1, columns, sharey=True, squeeze=False, gridspec_kw=edges, subplot_kw=shown)
    return figure, list(panels[0])


def _explain(figure: Figure, summary: Summary, step_s: float, *, estimated: bool) -> None:
    """The title, how the run ended, and the meaning of the marks."""
    width_in, height_in = figure.get_size_inches()
    left = LEFT_IN / width_in
    title = f"Scenario {summary.scenario}, goals: {summary.goals}"
    for text, below_top_in, largest_font, weight in (
        (title, 0.3, 14.0, "bold"),
        (verdict_line(summary, step_s), 0.58, 10.0, "normal"),
    ):
        font = min(largest_font, WIDEST_TEXT * width_in / len(text))
        figure.text(left, 1.0 - below_top_in / height_in, text, fontsize=font, fontweight=weight, va="center")
    robot = legend_mark("o", 14, "none", edge="0.6"), legend_mark("o", 10, "0.4")
    entries: dict[str, Any] = {
        "path driven": Line2D([], [], color="0.4", linewidth=1.8),
        "robot with safety margin; tip: heading": robot,
        "goal": legend_mark(GOAL, 11, "0.4"),
    }
    if estimated:
        line = Line2D([], [], color="0.4", linewidth=0.9, linestyle=DASHED)
        entries["estimated goal"] = line, legend_mark(ESTIMATE, 7, "white", edge="0.4", edge_width=1.4)
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="lower left",
        bbox_to_anchor=(left, 0.12 / height_in),
        borderaxespad=0.0,
        borderpad=0.0,
        ncols=len(entries) if len(figure.axes) > 1 else 2,
        frameon=False,
        handlelength=2.6,
        columnspacing=2.4,
    )


def legend_mark(
    marker: str, size: float, face: str, *, edge: str = "none", edge_width: float = 0.8
) -> Line2D:
    """A mark as a legend shows it; size and width in points."""
    return Line2D([], [], ls="none", marker=marker, ms=size, mfc=face, mec=edge, mew=edge_width)
