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

from agent.estimate.goals import first_guess, goals_at, inside, sigmas_of, way_m
from agent.estimate.window import Window, WindowStarts, problem_from, window_of
from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.realtime.solver import RealTimeSolver, respond
from agent.solve.vehicle import Array
from protocol.scene import Scene

SIGMAS = np.array([0.06, 0.06, 1.0, 0.45])
"""σ of p_x, p_y, ψ and v, in parts of the robot's ``way_m``, rad and of its top speed: how well the model
explains a robot. It plans anew at every step, among beliefs that differ from the ones of now, and windows
overlap, so that a step is looked at K_w times: a stretch of driving says much less than its exact poses
promise."""
GUESSED = 0.5
"""Standard deviation of the first guess, in parts of ``way_m`` as the next ones."""
FORGETTING = 1.2
"""Factor on the covariance of an estimate from one step to the next."""
DRIFT = 0.012
"""Standard deviation that is added to it."""
LONGEST = 0.17
"""A goal moves no further in a round: derivatives hold nearby."""
TOLERANCE = 1e-3
"""Of the optimality conditions: a step towards the goals needs less than a trajectory that is driven."""
STANDING_STEPS = 10
"""A robot that was slower for so many steps than a first step from a stand makes it, stands."""
BRAKING_STEPS = 3
"""Over so many steps a deceleration is averaged,"""
LESS = 0.5
"""and a goal near enough for it is believed in if it leaves no more than this part of what is unexplained."""
SOLVER = RealTimeSolver(5, Deadline(lambda: 0.0, None))
"""For what a robot alone would have done; close enough to judge a guess by. Independent of the clock."""


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
        self._beliefs = {
            robot: self._beliefs.get(robot) or self._first(memory, robot) for robot in memory.robots
        }
        window = window_of(memory, memory.robots, self._scene)
        if window:
            unexplained = self._fit(window)
            for index in range(len(window.robots)):
                self._place_braking(window, index, unexplained[index])
            self._place_standing(window)
        return goals_at(self._scene, memory, {robot: self._beliefs[robot].mean for robot in self._beliefs})

    def _first(self, memory: Memory, robot: str) -> Belief:
        variance = (GUESSED * self._way_m(robot)) ** 2
        return Belief(first_guess(self._scene, memory, robot), variance * np.eye(2))

    def _way_m(self, robot: str) -> float:
        return way_m(self._scene.robot(robot).limits)

    def _place_braking(self, window: Window, index: int, unexplained: float) -> None:
        """Who brakes and is not explained may do it for a goal that is near.

        The fit cannot find that out: at its limit of speed a robot drives on for a goal far away as for one a
        little nearer, so that no derivative leads back.
        """
        robot, states = window.robots[index], window.states[index]
        x, y, heading, speed = states[-1]
        acceleration = float(window.inputs[index, -BRAKING_STEPS:, 1].mean())
        if speed * acceleration >= 0.0:
            return
        stopping_m = speed * abs(speed) / (2.0 * abs(acceleration))
        stop = np.array([x + stopping_m * np.cos(heading), y + stopping_m * np.sin(heading)])
        own = slice(index, index + 1)
        alone = Window(
            window.robots[own],
            window.step,
            window.begin[own],
            window.before[own],
            states[None],
            window.inputs[own],
        )
        goal = inside(self._scene.area, stop)
        problem = problem_from(self._scene, alone, goal[None])
        driven = SOLVER.solve(problem, WindowStarts().start(problem, alone))
        missing = states - driven.states[0, 1 : len(states) + 1]
        if driven.solved and self._unexplained([robot], missing[None])[0] < LESS * unexplained:
            self._beliefs[robot] = Belief(goal, self._beliefs[robot].covariance)

    def _unexplained(self, robots: Sequence[str], missing: Array) -> Array:
        """Squares of what is missing (N, K_w, 4) over its variances, summed for each robot, shape (N,)."""
        squares = (missing / sigmas_of(self._scene, robots, SIGMAS)[:, None]) ** 2
        unexplained: Array = squares.sum(axis=(1, 2))
        return unexplained

    def _place_standing(self, window: Window) -> None:
        """Who stands has come to its goal, or will show another one by driving on.

        The fit cannot find that out: to a goal far away a robot drives off as hard as its limits allow, and
        as hard to one that is a little nearer, so that no derivative leads back.
        """
        if window.states.shape[1] < STANDING_STEPS:
            return
        for robot, states in zip(window.robots, window.states, strict=True):
            slow_mps = self._scene.robot(robot).limits.jerk_mps3 * self._scene.step_s**2
            if np.abs(states[-STANDING_STEPS:, 3]).max() < slow_mps:
                self._beliefs[robot] = Belief(states[-1, :2].copy(), self._beliefs[robot].covariance)

    def _fit(self, window: Window) -> Array:
        """Improve the beliefs by a window; what it leaves unexplained of each robot, shape (N,)."""
        robots, length = window.robots, window.states.shape[1]
        prior, information = self._prior(robots)
        problem = problem_from(self._scene, window, prior)
        start = self._starts.start(problem, window)
        response = respond(problem, start, length if start.warm else 0, TOLERANCE)
        self._starts.keep(window, response.solution)
        # One iteration from a cold start is not enough to be the solution for these goals.
        if not response.solution.solved or not start.warm:
            return np.zeros(len(robots))
        missing = window.states - response.solution.states[:, 1 : length + 1]
        sigmas = sigmas_of(self._scene, robots, SIGMAS)
        longest_m = LONGEST * np.array([self._way_m(robot) for robot in robots])
        means, covariance = gauss_newton(prior, information, response.by_goal, missing, sigmas, longest_m)
        for index, robot in enumerate(robots):
            own = slice(2 * index, 2 * index + 2)
            self._beliefs[robot] = Belief(inside(self._scene.area, means[index]), covariance[own, own])
        return self._unexplained(robots, missing)

    def _prior(self, robots: Sequence[str]) -> tuple[Array, Array]:
        """Last step's estimates (N, 2), and their information (2N, 2N) after some of it was forgotten."""
        information = np.zeros((2 * len(robots), 2 * len(robots)))
        for index, robot in enumerate(robots):
            here, way = slice(2 * index, 2 * index + 2), self._way_m(robot)
            loose = FORGETTING * self._beliefs[robot].covariance + (DRIFT * way) ** 2 * np.eye(2)
            axes, directions = np.linalg.eigh(loose)
            information[here, here] = directions / np.minimum(axes, (GUESSED * way) ** 2) @ directions.T
        return np.array([self._beliefs[robot].mean for robot in robots]), information


def gauss_newton(
    prior: Array, information: Array, by_goal: Array, missing: Array, sigmas: Array, longest_m: Array
) -> tuple[Array, Array]:
    """One step from the prior towards the maximum a posteriori estimate.

    Args:
        prior: L⁻, shape (N, 2), in m.
        information: P⁻¹, shape (2N, 2N).
        by_goal: ∂x_k/∂L at the prior, shape (2N, N, K_w, 4).
        missing: x̄_k − x_k, shape (N, K_w, 4).
        sigmas: σ of the states, shape (N, 4).
        longest_m: how far each goal moves at most, shape (N,).

    Returns:
        The improved estimates (N, 2) and the covariance (2N, 2N) of the linearised problem.
    """
    jacobian = (by_goal / sigmas[:, None]).reshape(len(by_goal), -1)
    covariance = np.linalg.inv(jacobian @ jacobian.T + information)
    change = (covariance @ jacobian @ (missing / sigmas[:, None]).ravel()).reshape(-1, 2)
    lengths = np.linalg.norm(change, axis=1)
    parts = np.minimum(1.0, longest_m / np.maximum(lengths, longest_m))
    improved: Array = prior + change * parts[:, None]
    return improved, np.asarray(covariance, dtype=np.float64)
