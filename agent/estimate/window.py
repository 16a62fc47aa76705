"""The last steps of robots, and the joint problem (eq. 7) that says how they would have driven them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agent.remember.memory import Memory
from agent.solve.problem import JointProblem, Solution, Start, joint_problem
from agent.solve.starts import WarmStarts
from agent.solve.vehicle import Array, recovered_inputs
from protocol.scene import Scene
from protocol.vehicle import STANDSTILL, Input

WINDOW = 12
"""K_w: steps that are explained, or as many as all robots were seen."""
LEAST_WINDOW = 2
"""An input shows in the position two steps later."""


class Window(NamedTuple):
    """What was seen of N robots over K_w steps."""

    robots: Sequence[str]
    step: int
    """At which it begins."""
    begin: Array
    """States then, shape (N, 4)."""
    before: list[Input]
    """The inputs that had led there; of a robot that was not seen before, none."""
    states: Array
    """At the steps after that, shape (N, K_w, 4)."""
    inputs: Array
    """That led there, shape (N, K_w, 2)."""


def window_of(memory: Memory, robots: Sequence[str], scene: Scene) -> Window | None:
    """The last K_w steps, or as many as all these robots were seen and a problem goes ahead.

    Returns:
        None where they are so few that nothing shows.
    """
    most = min(WINDOW, scene.horizons.prediction_steps)
    length = min(len(memory.states(robot, most + 1)) - 1 for robot in robots)
    if length < LEAST_WINDOW:
        return None
    tracks = [memory.states(robot, length + 2) for robot in robots]
    inputs = [recovered_inputs(track, scene.step_s) for track in tracks]
    return Window(
        robots=robots,
        step=memory.step - length,
        begin=np.array([track[-length - 1] for track in tracks]),
        before=[Input(*each[0].tolist()) if len(each) > length else STANDSTILL for each in inputs],
        states=np.array([track[-length:] for track in tracks]),
        inputs=np.array([each[-length:] for each in inputs]),
    )


def problem_from(
    scene: Scene, window: Window, goals: Array, others: Mapping[str, Array] = {}
) -> JointProblem:
    """The problem from where a window begins, for goals at these positions (N, 2) and with present headings.

    ``others`` are paths (K + 1, 2) of robots that are obstacles.
    """
    headings = window.states[:, -1, 2:3]
    states = np.concatenate([goals, headings, np.zeros_like(headings)], axis=1)
    begin, goal, before = (
        dict(zip(window.robots, each, strict=True)) for each in (window.begin, states, window.before)
    )
    return joint_problem(scene, begin, goal, others, before)


class WindowStarts:
    """Where the solution of a window's problem starts: from the last window's."""

    def __init__(self) -> None:
        self._starts = WarmStarts()
        self._step = 0

    def start(self, problem: JointProblem, window: Window) -> Start:
        """What was driven and, from the present on, the last solution."""
        if window.step < self._step:  # a robot that was seen only briefly has gone
            self._starts = WarmStarts()
        start = self._starts.start(problem, window.robots, max(window.step - self._step, 0))
        self._step = window.step
        start.inputs[:, : window.inputs.shape[1]] = window.inputs
        return start

    def keep(self, window: Window, solution: Solution) -> None:
        """Remember the solution for that window; where it is not solved, start cold next time."""
        self._starts.keep(window.robots, solution)
