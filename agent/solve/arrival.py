"""Plan to arrive early: the default method's own plan.

The cost of eq. 1, a sum of squares, approaches a goal ever more slowly, and does not see a wrong heading
before it is all that is left. What counts is when the robot has arrived. So this plan minimises at how many
of its stages the robot is not there yet, smoothly counted:

    Σ_k c(e_k²),    c(e²) = e² / (s² + e²),    e² = ‖p − p_L‖² + d² (ψ − ψ_L)² + Δt² v²

The safety distance d from a robot of its kind measures a radian, as a step Δt does a speed; s is half the
arrival tolerance, or a small part of d if that is more.

c is concave in e², so squares weighted by its slope at a known plan lie above it,

    c(e²) ≤ c(ē²) + w (e² − ē²),    w = c'(ē²) = s² / (s² + ē²)²

and who makes them smaller makes the count smaller: majorise and minimise, with the weights of Geman and
McClure's estimator. The last plan is the known one, so that a step costs no more than with eq. 1; only the
weights differ from stage to stage, low on the way and high from where the plan arrives.

The others cannot know: they go on predicting by eq. 7, and this robot reckons with that.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.planning import Plan, Planner, Room, Task
from agent.solve.prediction import Prediction
from agent.solve.problem import JointProblem, JointSolver, Solution, Start, within_limits
from agent.solve.sides import side_of
from agent.solve.starts import AWAY, POOR, cold_start, comes_to_rest, is_poor
from agent.solve.vehicle import Array, Booleans
from agent.solve.yielding import Yielding
from protocol.scene import Scene
from protocol.vehicle import Input

WITHIN = 0.5
"""s in arrival tolerances, so that a plan that only just arrives is improved on."""
SHARPEST = 0.02
"""The least s in safety distances: weights differ by the fourth power of the way in them."""


class EarlyPlanner(Planner):
    """Plans for one robot to be at its goal as early as it can be.

    Each plan starts from the last one, whose weights it needs; where that passes somebody on another side
    than the self-prediction, from the latter. A plan that comes too close or ends before somebody for good is
    compared with other starts: from the self-prediction, and as if the robot were alone. Where it ends beside
    the goal, there and back again. Where robots that stand hold this one up, it backs off in its turn.
    """

    def __init__(self, scene: Scene, robot: str, solver: JointSolver, deadline: Deadline) -> None:
        super().__init__(scene, robot, solver, deadline)
        self._yielding = Yielding(scene, robot)
        self._known: Array | None = None
        self._size_m = scene.safety_distance_m(robot, robot)
        self._sharp_m = max(WITHIN * scene.arrival_tolerance, SHARPEST * self._size_m)

    def plan(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction, room: Room) -> Plan:
        """See :meth:`Planner.plan`."""
        destination = self._yielding.destination(memory, goal)
        plan = super().plan(memory, destination, previous, prediction, room)
        stops = plan.solved and comes_to_rest(plan.states[:, :2], self._size_m)
        self._yielding.judge(memory, stops and bool(self._away(plan.states, goal)[-1]))
        self._known = np.concatenate([plan.states[1:], plan.states[-1:]]) if plan.solved else None
        return plan

    def _caution_m(self, memory: Memory, other: str) -> float:
        return super()._caution_m(memory, other) - self._yielding.concession_m(memory, other)

    def _is_expected(self, problem: JointProblem, expected: Start, states: Array) -> bool:
        """Whether a plan (K + 1, 4) passes everybody on the side on which the self-prediction does."""
        predicted = problem.rollout(expected.inputs)[0]
        for path, safety_m in zip(problem.obstacles, problem.safety_distances[0, 1:], strict=True):
            sides = [
                side_of(path - way[:, :2], float(safety_m), self._scene.safety_margin_m)
                for way in (predicted, states)
            ]
            if sides[0] * sides[1] < 0.0:
                return False
        return True

    def _away(self, states: Array, goal: Array) -> Booleans:
        """Which of the stages (n, 4) are not at the goal, shape (n,)."""
        away: Booleans = np.linalg.norm(states - goal, axis=1) > self._scene.arrival_tolerance
        return away

    def _weighted(self, problem: JointProblem, known: Array) -> JointProblem:
        units = units_of(problem)
        weights = arrival_weights(problem.weights, known, problem.goals[0], units, self._sharp_m)
        return replace(problem, weights=weights)

    def _solved(self, task: Task) -> Solution:
        problem = task.problem
        first, *others = self._starts_of(task)
        found = first()
        for other in others:
            if not is_poor(problem, found) or self._deadline.has_passed():
                break
            found = min(found, other(), key=partial(self._rank, problem))
        if self._ends_beside(problem, found):
            for direction in (1.0, -1.0):
                if not self._deadline.has_passed():
                    there_and_back = self._there_and_back(problem, direction)
                    found = min(found, there_and_back, key=partial(self._rank, problem))
        return found

    def _starts_of(self, task: Task) -> Iterator[Callable[[], Solution]]:
        """Ways to a plan, in order of preference: from the last one, from what is expected, as if alone."""
        problem = task.problem

        def solved_from(make: Callable[[], Start]) -> Solution:
            start = make()
            return self._improved(problem, start, problem.rollout(start.inputs)[0])

        expected, known = task.expected, self._known
        if known is not None and (expected is None or self._is_expected(problem, expected, known)):
            last = self._starts.start(problem, [self._robot])
            yield lambda: self._improved(problem, last, known)
        if expected is not None:
            yield lambda: solved_from(lambda: expected)
        yield lambda: solved_from(task.as_if_alone)

    def _improved(self, problem: JointProblem, start: Start, known: Array) -> Solution:
        return self._solver.solve(self._weighted(problem, known), start)

    def _there_and_back(self, problem: JointProblem, direction: float) -> Solution:
        """A manoeuvre that ends at the goal and rests there for the last quarter of the horizon.

        A robot that stands cannot move sideways, not to first order; one that drives off and comes back can.
        """
        quarter = np.arange(problem.steps) * 4 // problem.steps
        inputs = np.zeros((1, problem.steps, 2))
        inputs[0, :, 1] = np.array([1.0, -1.0, -1.0, 1.0])[quarter]
        inputs *= 0.5 * direction * problem.input_bounds[0, 1]
        start = cold_start(problem, within_limits(problem, inputs))
        known = problem.rollout(start.inputs)[0]
        known[-1 - problem.steps // 4 :] = problem.goals[0]
        found = self._improved(problem, start, known)
        return self._improved(problem, found.start(), found.states[0])

    def _rank(self, problem: JointProblem, solution: Solution) -> tuple[bool, bool, float]:
        """By which the least of several plans is the best: solved, clear of others, early there."""
        states, goal = solution.states[0], problem.goals[0]
        excess = solution.violation_m / problem.size_m
        count = float(self._away(states, goal).sum()) + problem.steps * excess
        smooth = stages_away(states, goal, units_of(problem), self._sharp_m) / (problem.steps + 1)
        return not solution.solved, excess > POOR, count + smooth

    def _ends_beside(self, problem: JointProblem, solution: Solution) -> bool:
        """Whether the robot comes to rest near its goal, but not there."""
        states, goal = solution.states[0], problem.goals[0]
        is_near = bool(np.linalg.norm(states[-1, :2] - goal[:2]) <= AWAY * problem.size_m)
        is_beside = is_near and bool(self._away(states, goal)[-1])
        return solution.solved and is_beside and comes_to_rest(states[:, :2], problem.size_m)


def units_of(problem: JointProblem) -> Array:
    """What one of each component of a state counts in metres, shape (4,)."""
    return np.array([1.0, 1.0, problem.size_m, problem.step_s])


def _squares(states: Array, goal: Array, units: Array) -> Array:
    """e² of stages (n, 4), shape (n,)."""
    squares: Array = (((states - goal) * units) ** 2).sum(axis=1)
    return squares


def stages_away(states: Array, goal: Array, units: Array, sharp_m: float) -> float:
    """How many of the stages (n, 4) are not at the goal (4,), each counted from 0 to 1; ``sharp_m`` is s."""
    squares = _squares(states, goal, units)
    return float((squares / (sharp_m**2 + squares)).sum())


def arrival_weights(weights: Array, known: Array, goal: Array, units: Array, sharp_m: float) -> Array:
    """Weights (K + 1, 4) of squares that lie above the count of stages away and touch it at a known plan.

    Args:
        weights: those of eq. 1, shape (K + 1, 4). The mean of those of positions is kept, so that prices of
            distances stay what they are.
        known: states of the known plan, shape (K + 1, 4).
        goal: L, shape (4,).
        units: see :func:`units_of`.
        sharp_m: s.
    """
    squares = _squares(known, goal, units)
    slopes = 1.0 / (sharp_m**2 + squares) ** 2
    slopes *= weights[1:, :2].max() / slopes[1:].mean()
    result: Array = slopes[:, None] * units**2
    return result
