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

from agent.estimate.goals import AHEAD_SIGMA_M, ahead, goals_at, inside
from agent.estimate.window import Window, WindowStarts, problem_from, window_of
from agent.remember.memory import Memory
from agent.solve.realtime.solver import respond
from agent.solve.vehicle import Array
from protocol.scene import Scene

SIGMAS = np.array([0.5, 0.5, 1.0, 2.0])
"""σ of p_x, p_y, ψ and v, in m, rad and m/s: how well the model explains a robot. It plans anew at every
step, among beliefs that differ from the ones of now, and windows overlap, so that a step is looked at K_w
times: a stretch of driving says much less than its exact poses promise."""
FORGETTING = 1.2
"""Factor on the covariance of an estimate from one step to the next."""
DRIFT_M = 0.1
"""Standard deviation that is added to it."""
TOLERANCE = 1e-3
"""Of the optimality conditions: a step towards the goals needs less than a trajectory that is driven."""
STANDING_STEPS, STANDING_MPS = 10, 0.05
"""A robot that was slower than this for so many steps stands."""
LONGEST_M = 1.5
"""A goal moves no further in a round: derivatives hold nearby."""


class Belief(NamedTuple):
    """What is thought of a goal's position: mean (2,) in m, covariance (2, 2) in m²."""

    mean: Array
    covariance: Array


class JointFit:
    """The project's own estimator; it keeps a belief in every robot's goal."""

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._beliefs: dict[str, Belief] = {}
        self._starts = WindowStarts()

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimate.goals.GoalEstimator`."""
        area, variance = self._scene.area, AHEAD_SIGMA_M**2 * np.eye(2)
        self._beliefs = {
            robot: self._beliefs.get(robot) or Belief(ahead(area, memory.state(robot)), variance)
            for robot in memory.robots
        }
        window = window_of(memory, memory.robots, self._scene)
        if window:
            self._fit(window)
            self._place_standing(window)
        return goals_at(self._scene, memory, {robot: self._beliefs[robot].mean for robot in self._beliefs})

    def _place_standing(self, window: Window) -> None:
        """Who stands has come to its goal, or will show another one by driving on.

        The fit cannot find that out: to a goal far away a robot drives off as hard as its limits allow, and
        as hard to one that is a little nearer, so that no derivative leads back.
        """
        if window.states.shape[1] < STANDING_STEPS:
            return
        for robot, states in zip(window.robots, window.states, strict=True):
            if np.abs(states[-STANDING_STEPS:, 3]).max() < STANDING_MPS:
                self._beliefs[robot] = Belief(states[-1, :2].copy(), self._beliefs[robot].covariance)

    def _fit(self, window: Window) -> None:
        """Improve the beliefs by a window."""
        prior, information = _prior([self._beliefs[robot] for robot in window.robots])
        length = window.states.shape[1]
        problem = problem_from(self._scene, window, prior)
        start = self._starts.start(problem, window)
        response = respond(problem, start, length if start.warm else 0, TOLERANCE)
        self._starts.keep(window, response.solution)
        # One iteration from a cold start is not enough to be the solution for these goals.
        if not response.solution.solved or not start.warm:
            return
        missing = window.states - response.solution.states[:, 1 : length + 1]
        means, covariance = gauss_newton(prior, information, response.by_goal, missing)
        for index, robot in enumerate(window.robots):
            own = slice(2 * index, 2 * index + 2)
            self._beliefs[robot] = Belief(inside(self._scene.area, means[index]), covariance[own, own])


def _prior(beliefs: Sequence[Belief]) -> tuple[Array, Array]:
    """Last step's estimates (N, 2), and their information (2N, 2N) after some of it was forgotten."""
    information = np.zeros((2 * len(beliefs), 2 * len(beliefs)))
    for index, belief in enumerate(beliefs):
        here = slice(2 * index, 2 * index + 2)
        loose = FORGETTING * belief.covariance + DRIFT_M**2 * np.eye(2)
        axes, directions = np.linalg.eigh(loose)
        information[here, here] = directions / np.minimum(axes, AHEAD_SIGMA_M**2) @ directions.T
    return np.array([belief.mean for belief in beliefs]), information


def gauss_newton(prior: Array, information: Array, by_goal: Array, missing: Array) -> tuple[Array, Array]:
    """One step from the prior towards the maximum a posteriori estimate.

    Args:
        prior: L⁻, shape (N, 2), in m.
        information: P⁻¹, shape (2N, 2N).
        by_goal: ∂x_k/∂L at the prior, shape (2N, N, K_w, 4).
        missing: x̄_k − x_k, shape (N, K_w, 4).

    Returns:
        The improved estimates (N, 2), each moved by no more than ``LONGEST_M``, and the covariance (2N, 2N)
        of the linearised problem.
    """
    jacobian = (by_goal / SIGMAS).reshape(len(by_goal), -1)
    covariance = np.linalg.inv(jacobian @ jacobian.T + information)
    change = (covariance @ jacobian @ (missing / SIGMAS).ravel()).reshape(-1, 2)
    lengths = np.linalg.norm(change, axis=1, keepdims=True)
    return prior + change * np.minimum(1.0, LONGEST_M / np.maximum(lengths, LONGEST_M)), covariance
