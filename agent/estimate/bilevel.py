"""Bilevel inverse optimal control: of each robot by itself, the goal that makes its own problem explain it.

After Reiter, Messerer, Schratter, Watzenig and Diehl (2022), "An inverse optimal control approach for
trajectory prediction of autonomous race cars". The lower level is the forward problem, here eq. 1 of one
robot, solved to convergence from its state K_w steps ago; the upper level adapts the parameter, here the
position L of the goal, by Levenberg–Marquardt on

    Σ_k ‖x̄_k − x_k(L)‖² / σ²  +  ‖L − L⁻‖² / σ_L²

x̄ being the observed states, x(L) the solution and L⁻ the last step's estimate. Different here: only the goal
is unknown, not weights; the other robots are there as obstacles that move as observed, and from the present
on straight ahead. Unlike ``joint_fit`` it solves to convergence in every iteration, each robot by itself, and
carries no covariance on.
"""

from typing import NamedTuple

import numpy as np

from agent.estimate.goals import first_guess, goals_at, inside, sigmas_of, way_m
from agent.estimate.window import Window, WindowStarts, problem_from, window_of
from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.problem import JointProblem, Solution, Start
from agent.solve.realtime.solver import RealTimeSolver, respond
from agent.solve.vehicle import Array, rollout
from protocol.scene import Area, Scene

SIGMAS = np.array([0.006, 0.006, 0.1, 0.045])
"""σ of p_x, p_y, ψ and v, in parts of the robot's ``way_m``, rad and its top speed."""
PULL = 0.23
"""σ_L: how far from the last step's estimate the next one may well be, in parts of ``way_m``."""
ITERATIONS = 4
"""Of the upper level, a step."""
SETTLED = 0.002
"""Less than this part of ``way_m`` is no move."""
UNEXPLAINED = 2.0
"""Misfit a number seen (half a square: 2σ) above which the present position is tried as a goal too. All goals
far away make a robot that stands drive off in the same way, so that no derivative leads to where it is."""
FIRST_DAMPING = 0.75
"""Of Levenberg–Marquardt, in one over the square of ``way_m``; a tenth after a step that helps, tenfold after
one that does not."""
SOLVER = RealTimeSolver(10, Deadline(lambda: 0.0, None))
"""Of the lower level: to convergence, which usually takes 1 to 4 iterations from the last solution, and no
longer than 10. No estimate depends on the clock."""


class Fit(NamedTuple):
    """A goal, the lower level's solution for it, and the upper level's objective there, to second order."""

    goal: Array
    solution: Solution
    misfit: float
    gradient: Array
    curvature: Array

    def beats(self, other: "Fit") -> bool:
        """Whether this goal explains more."""
        return self.solution.solved and self.misfit < other.misfit


class Bilevel:
    """Keeps the last estimate and the last solution of every robot."""

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._goals: dict[str, Array] = {}
        self._starts: dict[str, WindowStarts] = {}

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimate.goals.GoalEstimator`."""
        robots = memory.robots
        self._starts = {robot: self._starts.get(robot, WindowStarts()) for robot in robots}
        self._goals = {robot: self._estimate_one(memory, robot) for robot in robots}
        return goals_at(self._scene, memory, self._goals)

    def _estimate_one(self, memory: Memory, robot: str) -> Array:
        """The position (2,) of a robot's goal."""
        last = self._goals.get(robot)
        if last is None:
            last = first_guess(self._scene, memory, robot)
        window = window_of(memory, [robot], self._scene)
        if window is None:
            return last
        forward, starts = ForwardProblem(self._scene, memory, window), self._starts[robot]
        fit = fitted(forward, last, starts.start(forward.of(last), window), self._scene.area)
        starts.keep(window, fit.solution)
        return fit.goal


class ForwardProblem:
    """The lower level: eq. 1 of one robot, from where a window of its driving begins, for any goal."""

    def __init__(self, scene: Scene, memory: Memory, window: Window) -> None:
        self._scene = scene
        self.window = window
        self.way_m = way_m(scene.robot(window.robots[0]).limits)
        self._sigmas = sigmas_of(scene, window.robots, SIGMAS)[0]
        length, steps = window.states.shape[1], scene.horizons.prediction_steps
        self._others = {
            other: _path(memory.states(other, length + 1), length, steps, scene.step_s)
            for other in memory.robots
            if other not in window.robots
        }

    def of(self, goal: Array) -> JointProblem:
        """For a goal at that position (2,), its heading the present one."""
        return problem_from(self._scene, self.window, goal[None], self._others)

    def fit(self, goal: Array, start: Start, last: Array) -> Fit:
        """Solve for a goal to convergence, and judge it by how the solution moves with it."""
        problem, states = self.of(goal), self.window.states
        length = states.shape[1]
        response = respond(problem, SOLVER.solve(problem, start).start(), length)
        missing = ((states - response.solution.states[:, 1 : length + 1]) / self._sigmas).ravel()
        jacobian = (response.by_goal / self._sigmas).reshape(2, -1)
        pull_m = PULL * self.way_m
        off = (goal - last) / pull_m
        return Fit(
            goal,
            response.solution,
            misfit=float(0.5 * (missing @ missing + off @ off)),
            gradient=off / pull_m - jacobian @ missing,
            curvature=jacobian @ jacobian.T + np.eye(2) / pull_m**2,
        )


def fitted(forward: ForwardProblem, last: Array, start: Start, area: Area) -> Fit:
    """The upper level: improve an estimate (2,) by Levenberg–Marquardt; not where it cannot be solved for."""
    first_damping = FIRST_DAMPING / forward.way_m**2
    best, damping = forward.fit(last, start, last), first_damping
    if not best.solution.solved:
        return best
    if best.misfit > UNEXPLAINED * forward.window.states.size:
        arrived = forward.fit(inside(area, forward.window.states[0, -1, :2]), start, last)
        best = arrived if arrived.beats(best) else best
    for _ in range(ITERATIONS):
        change = np.linalg.solve(best.curvature + damping * np.eye(2), -best.gradient)
        there = inside(area, best.goal + change)
        if np.linalg.norm(there - best.goal) < SETTLED * forward.way_m:
            break
        tried = forward.fit(there, best.solution.start(), last)
        if tried.beats(best):
            best, damping = tried, 0.1 * damping
        else:
            damping = 10.0 * max(damping, first_damping)
    return best


def _path(seen: Array, length: int, steps: int, step_s: float) -> Array:
    """Positions (steps + 1, 2) of another robot: as seen up to the present, before and after straight on.

    Seen are its states (n, 4), n from 1 to length + 1; the present is ``length`` steps after the begin.
    """
    back = rollout(seen[0] * [1.0, 1.0, 1.0, -1.0], np.zeros((length + 1 - len(seen), 2)), step_s)
    on = rollout(seen[-1], np.zeros((steps - length, 2)), step_s)
    return np.concatenate([back[:0:-1], seen, on[1:]])[:, :2]
