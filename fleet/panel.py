"""One panel of a picture: the run as it was at one time."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patches import Circle, Polygon
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from protocol.scenario import Scenario, ScenarioRobot

COLOURS = [to_hex(colour) for colour in mpl.color_sequences["petroff10"]]
"""Ten colours that stay distinct with impaired colour vision (Petroff 2021); more robots repeat them."""
GOAL, ESTIMATE = "*", "D"
AGREEMENT_M = 0.01
"""Observers whose estimates differ by less are of one opinion."""
TIP_RADII = 1.4
"""How far the tip that shows the heading reaches from the centre, in radii of the body."""
SMALLEST_FONT, LARGEST_FONT = 5.0, 9.0

Pose = NDArray[np.float64]
Estimates = Mapping[str, Sequence[tuple[float, float]]]


class View(NamedTuple):
    """The shown rectangle and its scale on paper."""

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float
    points_per_m: float


@dataclass(frozen=True)
class Panel:
    """Draws one moment of a run into axes."""

    axes: Axes
    view: View
    scenario: Scenario

    def draw(self, poses: Mapping[str, NDArray[np.float64]], estimates: Estimates, time_s: float) -> None:
        """Draw everything as it was at a time.

        Args:
            poses: by robot, time in s, x and y in m and heading in rad, shape (steps, 4), in order of time.
            estimates: by robot, its goal as each observer estimated it, in m.
            time_s: the time.
        """
        past = {name: rows[rows[:, 0] <= time_s + 1e-9] for name, rows in poses.items()}
        present_s = max((rows[-1, 0] for rows in past.values() if len(rows)), default=0.0)
        for index, robot in enumerate(self.scenario.robots):
            colour = COLOURS[index % len(COLOURS)]
            rows = past.get(robot.id, np.empty((0, 4)))
            # A robot that has left the run before leaves only its way.
            pose = rows[-1, 1:] if len(rows) and rows[-1, 0] == present_s else None
            self._way(rows[:, 1:3], colour)
            self._goal(robot, pose, colour)
            if pose is not None:
                self._robot(robot, pose, colour)
                self._estimates(robot, pose, estimates.get(robot.id, ()), colour)

    def _goal(self, robot: ScenarioRobot, pose: Pose | None, colour: str) -> None:
        goal = (robot.goal.x_m, robot.goal.y_m)
        self.axes.plot(
            *goal,
            marker=GOAL,
            markersize=13,
            markerfacecolor=colour,
            markeredgecolor="white",
            markeredgewidth=0.8,
            zorder=_height(robot, pose, goal, 5.0),
        )

    def _way(self, points: NDArray[np.float64], colour: str) -> None:
        self.axes.plot(points[:, 0], points[:, 1], color=colour, linewidth=1.8, zorder=2)
        self.axes.plot(*points[:1].T, marker="o", markersize=3.5, color=colour, zorder=2)

    def _robot(self, robot: ScenarioRobot, pose: Pose, colour: str) -> None:
        x_m, y_m, heading_rad = pose.tolist()
        radius_m = robot.radius_m
        safe_m = radius_m + self.scenario.safety_margin_m
        self.axes.add_patch(Circle((x_m, y_m), safe_m, fill=False, edgecolor=colour, linewidth=0.7, zorder=3))
        self.axes.add_patch(Circle((x_m, y_m), radius_m, facecolor=colour, linewidth=0.0, zorder=3))
        # The sides of the tip touch the disc as tangents.
        side_rad = math.acos(1.0 / TIP_RADII)
        angles_rad = heading_rad + np.array([-side_rad, 0.0, side_rad])
        reach_m = radius_m * np.array([1.0, TIP_RADII, 1.0])
        tip = pose[:2] + np.column_stack((reach_m * np.cos(angles_rad), reach_m * np.sin(angles_rad)))
        self.axes.add_patch(Polygon(tip, facecolor=colour, linewidth=0.0, zorder=3))
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
        self,
        robot: ScenarioRobot,
        pose: Pose,
        goals: Sequence[tuple[float, float]],
        colour: str,
    ) -> None:
        opinions: list[tuple[float, float]] = []
        for goal in goals:
            if all(math.dist(goal, opinion) > AGREEMENT_M for opinion in opinions):
                opinions.append(goal)
        strength = 1.0 if len(opinions) <= 1 else 0.4
        for x_m, y_m in opinions:
            self.axes.plot(
                *((pose[0], x_m), (pose[1], y_m)),
                color=colour,
                linewidth=0.9,
                linestyle=(0, (4, 2)),
                alpha=0.8 * strength,
                zorder=2.5,
            )
            self.axes.plot(
                *(x_m, y_m),
                marker=ESTIMATE,
                markersize=6.5,
                markerfacecolor="white",
                markeredgecolor=colour,
                markeredgewidth=1.5,
                alpha=strength,
                zorder=_height(robot, pose, (x_m, y_m), 4.0),
            )


def _height(robot: ScenarioRobot, pose: Pose | None, point: tuple[float, float], above: float) -> float:
    """Drawing order of a mark: above the robots, but beneath its own robot, whose name it would hide."""
    beneath = pose is not None and math.dist(point, pose[:2]) < robot.radius_m
    return 2.9 if beneath else above


def _contrast(colour: str) -> str:
    """Black or white, whichever is easier to read on a colour (luminance after Rec. 709)."""
    return "black" if float(np.dot(to_rgb(colour), (0.2126, 0.7152, 0.0722))) > 0.5 else "white"
