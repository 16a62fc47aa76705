"""The last steps of all robots, and the joint problem (eq. 7) that says how they would have driven them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agent.estimate.goals import goal_inside
from agent.remember.memory import Memory
from agent.solve.multistart import WarmStarts
from agent.solve.problem import JointProblem, Solution, Start, joint_problem
from agent.solve.vehicle import Array, recovered_inputs
from protocol.scene import Area, Scene
from protocol.vehicle import STANDSTILL, Input

WINDOW = 12
"""K_w: steps that are explained, or as many as all robots were seen."""
LEAST_WINDOW = 2
"""An input shows in the position two steps later."""
AHEAD_M = 8.0
"""At first, a goal is thought to lie so far ahead of its robot,"""
AHEAD_SIGMA_M = 4.0
"""give or take so much."""


class Window(NamedTuple):
    """What was seen of all robots over K_w steps."""

    begin: Array
    """States before the first of them, shape (N, 4)."""
    before: list[Input]
    """The inputs that had led there."""
    states: Array
    """Shape (N, K_w, 4)."""
    inputs: Array
    """Shape (N, K_w, 2)."""


def window_length(memory: Memory, robots: Sequence[str], scene: Scene) -> int:
    """How many steps can be explained: K_w, or as many as these robots were seen and a problem goes ahead.

    Returns:
        Zero where it is so few that nothing shows.
    """
    most = min(WINDOW, scene.horizons.prediction_steps)
    length = min(len(memory.states(robot, most + 1)) - 1 for robot in robots)
    return length if length >= LEAST_WINDOW else 0


def window_of(memory: Memory, robots: Sequence[str], length: int, step_s: float) -> Window:
    """The last so many steps of robots that were seen at least one step longer.

    A robot that was not seen before them is taken to have driven without input.
    """
    tracks = [memory.states(robot, length + 2) for robot in robots]
    inputs = [recovered_inputs(track, step_s) for track in tracks]
    return Window(
        begin=np.array([track[-length - 1] for track in tracks]),
        before=[Input(*each[0].tolist()) if len(each) > length else STANDSTILL for each in inputs],
        states=np.array([track[-length:] for track in tracks]),
        inputs=np.array([each[-length:] for each in inputs]),
    )


def ahead(area: Area, state: Array) -> Array:
    """The position (2,) straight ahead, inside the area, where a goal is first thought to lie."""
    return inside(area, state[:2] + AHEAD_M * np.array([np.cos(state[2]), np.sin(state[2])]))


def inside(area: Area, position: Array) -> Array:
    """A position (2,) moved into the area."""
    return goal_inside(area, np.append(position, 0.0))[:2]


def goals_at(scene: Scene, memory: Memory, positions: Mapping[str, Array]) -> dict[str, Array]:
    """Goal states at these positions (2,), with the present headings: of those of goals nothing is known."""
    return {
        robot: goal_inside(scene.area, np.append(position, memory.state(robot)[2]))
        for robot, position in positions.items()
    }


def problem_from(scene: Scene, robots: Sequence[str], window: Window, goals: Array) -> JointProblem:
    """The joint problem from where a window begins, for goals at these positions (N, 2).

    Of a goal's heading nothing is known, so it is the present one.
    """
    headings = window.states[:, -1, 2:3]
    return joint_problem(
        scene,
        dict(zip(robots, window.begin, strict=True)),
        dict(zip(robots, np.concatenate([goals, headings, np.zeros_like(headings)], axis=1), strict=True)),
        {},
        dict(zip(robots, window.before, strict=True)),
    )


class WindowStarts:
    """Where the solution of a window's problem starts: from the last window's."""

    def __init__(self) -> None:
        self._starts = WarmStarts()
        self._begin = 0

    def start(self, problem: JointProblem, robots: Sequence[str], window: Window, begin: int) -> Start:
        """What was driven and, from the present on, the last solution; the window begins at that step."""
        if begin < self._begin:  # a robot that was seen only briefly has gone
            self._starts.forget()
        start = self._starts.starts(problem, robots, max(begin - self._begin, 0))[0]
        self._begin = begin
        start.inputs[:, : window.inputs.shape[1]] = window.inputs
        return start

    def keep(self, robots: Sequence[str], solution: Solution) -> None:
        """Remember the solution for that window."""
        self._starts.keep(robots, solution)

    def forget(self) -> None:
        """Start cold next time."""
        self._starts.forget()
