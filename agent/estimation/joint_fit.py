"""Joint fit: the goals for which the joint problem (eq. 7), solved from some steps ago, drives as was seen.

A bilevel, maximum a posteriori form of inverse optimal control in real-time iteration. Every step, the joint
problem of all robots is improved from the states observed K_w steps ago with the goals believed in, and these
by Gauss–Newton on

    Σ_k ‖x̄_k − x_k(L)‖² / σ²  +  (L − L⁻)ᵀ P⁻¹ (L − L⁻)    over the positions L of all goals,

x̄ being the observed states, x(L) the solution and L⁻ the last step's estimate, held less firmly. Unlike
eq. 6 it explains evasion as evasion, and remembers what a window does not show: how far a robot that speeds
up will go.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agent.estimation.interface import goal_inside
from agent.memory import Memory
from agent.problems import WarmStarts, joint_problem
from agent.solver.problem import JointProblem, Start
from agent.solver.realtime.solver import respond
from agent.vehicle import Array, recovered_inputs
from protocol.scene import Scene
from protocol.vehicle import STANDSTILL, Input

WINDOW = 12
"""K_w: steps that are explained, or as many as all robots were seen."""
LEAST_WINDOW = 2
"""An input shows in the position two steps later."""
SIGMAS = np.array([0.05, 0.05, 0.1, 0.2])
"""σ of p_x, p_y, ψ and v, in m, rad and m/s: how well the model explains a robot."""
AHEAD_M = 8.0
"""At first, a goal is thought to lie so far ahead of its robot,"""
AHEAD_SIGMA_M = 4.0
"""give or take so much. No estimate is held less firmly."""
FORGETTING = 4.0
"""Factor on the covariance of an estimate from one step to the next: windows overlap, so
that most of what a step shows was known before."""
DRIFT_M = 0.6
"""Standard deviation that is added to it."""
ROUNDS = 2
"""Iterations a step, of the joint problem and of the goals."""
COLD_ROUNDS = 3
"""Iterations of the joint problem before, where no last solution is there to start from."""
LONGEST_M = 1.5
"""A goal moves no further in a round: derivatives hold nearby."""


class Belief(NamedTuple):
    """What is thought of a goal's position."""

    mean: Array
    """Shape (2,), in m."""
    covariance: Array
    """Shape (2, 2), in m²."""


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


class JointFit:
    """The project's own estimator; it keeps a belief in every robot's goal."""

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._beliefs: dict[str, Belief] = {}
        self._starts = WarmStarts()
        self._begin = 0
        """Step at which the last window began."""

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimation.interface.GoalEstimator`."""
        robots = memory.robots
        self._beliefs = {
            robot: self._beliefs[robot] if robot in self._beliefs else self._first(memory.state(robot))
            for robot in robots
        }
        most = min(WINDOW, self._scene.horizons.prediction_steps)
        length = min(len(memory.states(robot, most + 1)) - 1 for robot in robots)
        if length >= LEAST_WINDOW:
            begin = memory.step - length
            self._fit(robots, window_of(memory, robots, length, self._scene.step_s), begin - self._begin)
            self._begin = begin
        return {robot: self._goal(robot, memory.state(robot)) for robot in robots}

    def _first(self, state: Array) -> Belief:
        """Straight ahead, inside the area."""
        ahead = state[:2] + AHEAD_M * np.array([np.cos(state[2]), np.sin(state[2])])
        return Belief(goal_inside(self._scene.area, np.append(ahead, 0.0))[:2], AHEAD_SIGMA_M**2 * np.eye(2))

    def _goal(self, robot: str, state: Array) -> Array:
        """The goal state believed in; of its heading nothing is known, so it is the present one."""
        return goal_inside(self._scene.area, np.append(self._beliefs[robot].mean, state[2]))

    def _fit(self, robots: Sequence[str], window: Window, steps_on: int) -> None:
        """Improve the beliefs by a window that begins so many steps after the last one."""
        if steps_on < 0:  # a robot that was seen only briefly has gone
            self._starts.forget()
        prior, information = _prior([self._beliefs[robot] for robot in robots])
        length, means = window.states.shape[1], prior
        start = self._start(self._problem(robots, window, means), robots, window, steps_on)
        for improving in [False] * (0 if start.warm else COLD_ROUNDS) + [True] * ROUNDS:
            response = respond(self._problem(robots, window, means), start, length)
            if not response.solution.solved:
                self._starts.forget()
                return
            start = response.solution.start()
            if improving:
                missing = window.states - response.solution.states[:, 1 : length + 1]
                means, covariance = gauss_newton(means, prior, information, response.by_goal, missing)
                means = np.array([goal_inside(self._scene.area, np.append(mean, 0.0))[:2] for mean in means])
        self._beliefs = {
            robot: Belief(means[index], covariance[2 * index : 2 * index + 2, 2 * index : 2 * index + 2])
            for index, robot in enumerate(robots)
        }
        self._starts.keep(robots, response.solution)

    def _problem(self, robots: Sequence[str], window: Window, means: Array) -> JointProblem:
        headings = window.states[:, -1, 2:3]
        goals = np.concatenate([means, headings, np.zeros_like(headings)], axis=1)
        return joint_problem(
            self._scene,
            dict(zip(robots, window.begin, strict=True)),
            dict(zip(robots, goals, strict=True)),
            {},
            dict(zip(robots, window.before, strict=True)),
        )

    def _start(self, problem: JointProblem, robots: Sequence[str], window: Window, steps_on: int) -> Start:
        """What was driven and, from the present on, the last solution."""
        start = self._starts.starts(problem, robots, steps_on)[0]
        start.inputs[:, : window.inputs.shape[1]] = window.inputs
        return start


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


def _prior(beliefs: Sequence[Belief]) -> tuple[Array, Array]:
    """Last step's estimates (N, 2), and their information (2N, 2N) after some of it was forgotten."""
    information = np.zeros((2 * len(beliefs), 2 * len(beliefs)))
    for index, belief in enumerate(beliefs):
        here = slice(2 * index, 2 * index + 2)
        loose = FORGETTING * belief.covariance + DRIFT_M**2 * np.eye(2)
        axes, directions = np.linalg.eigh(loose)
        information[here, here] = directions / np.minimum(axes, AHEAD_SIGMA_M**2) @ directions.T
    return np.array([belief.mean for belief in beliefs]), information


def gauss_newton(
    means: Array, prior: Array, information: Array, by_goal: Array, missing: Array
) -> tuple[Array, Array]:
    """One step towards the maximum a posteriori estimate.

    Args:
        means: estimates to improve, shape (N, 2), in m.
        prior: L⁻, shape (N, 2).
        information: P⁻¹, shape (2N, 2N).
        by_goal: ∂x_k/∂L at the estimates, shape (2N, N, K_w, 4).
        missing: x̄_k − x_k, shape (N, K_w, 4).

    Returns:
        The improved estimates (N, 2), each moved by no more than ``LONGEST_M``, and the covariance (2N, 2N)
        of the linearised problem.
    """
    jacobian = (by_goal / SIGMAS).reshape(len(by_goal), -1)
    covariance = np.linalg.inv(jacobian @ jacobian.T + information)
    gradient = jacobian @ (missing / SIGMAS).ravel() + information @ (prior - means).ravel()
    change = (covariance @ gradient).reshape(-1, 2)
    lengths = np.linalg.norm(change, axis=1, keepdims=True)
    return means + change * np.minimum(1.0, LONGEST_M / np.maximum(lengths, LONGEST_M)), covariance
