"""Plan: the ego's own problem with its true goal, the others moving as predicted (eq. 1)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.arrival import arrival_weights, manoeuvres, rests_beside, stages_away
from agent.solve.prediction import Prediction
from agent.solve.problem import JointProblem, JointSolver, Solution, Start, joint_problem
from agent.solve.sides import Sides, agreed_sides
from agent.solve.starts import POOR, Alone, WarmStarts, cold_start, is_deadlock, solve_well
from agent.solve.vehicle import Array
from agent.solve.yielding import Yielding
from protocol.scene import Scene
from protocol.vehicle import Input, Reachable



Room = Callable[[Array], Reachable | None]
"""Which inputs the lines of the reserve leave where a wanted first input (2,) is not allowed; None where it is."""


@dataclass(frozen=True)
class Plan:
    """What the ego means to do: inputs (n, 2), at least one, and the states (n + 1, 4) they lead through."""

    inputs: Array
    states: Array
    solved: bool


class Planner:
    """Plans for one robot, by eq. 1 or to arrive early.

    By eq. 1, each plan starts from the self-prediction, so that the ego passes the others where they expect
    it, or else from the last plan, one step on. To arrive early, it starts from the last plan, whose weights it
    needs, and from the self-prediction where nothing good comes of that. A plan that is still poor is compared
    with one that starts from what the ego would do if it were alone.

    Args:
        scene: what everybody may know.
        robot: the ego.
        solver: of trajectory problems.
        deadline: after it nothing is improved.
        arrives_early: whether to plan by :mod:`agent.solve.arrival` instead of eq. 1. The others cannot know,
            so they go on predicting by eq. 7.
    """

    def __init__(
        self, scene: Scene, robot: str, solver: JointSolver, deadline: Deadline, *, arrives_early: bool
    ) -> None:
        self._scene = scene
        self._robot = robot
        self._solver = solver
        self._deadline = deadline
        self._arrives_early = arrives_early
        self._starts = WarmStarts()
        self._alone = Alone(solver)
        self._last: Array | None = None
        self._yielding = Yielding(scene, robot)

    def plan(
        self, memory: Memory, goal: Array, previous: Input, prediction: Prediction, room: Room
    ) -> Plan:
        """Solve for the ego, among the predicted paths of all others, and in the room that lines leave it."""
        true_goal = goal
        if self._arrives_early:
            goal = self._yielding.destination(memory, goal)
        robot, present = self._robot, memory.present()
        others = {other: path for other, path in prediction.paths.items() if other != robot}
        cautions_m = {other: memory.caution_m(other) for other in others}

        def among(paths: Mapping[str, Array], sides: Sides) -> JointProblem:
            inputs = {robot: previous}
            return joint_problem(self._scene, present, {robot: goal}, paths, inputs, cautions_m, sides)

        alone: Solution | None = None

        def as_if_alone() -> Start:
            nonlocal alone
            alone = alone or self._alone.drive({robot: among({}, {})})[robot]
            return cold_start(problem, alone.inputs.copy())

        expected, sides = prediction.starts.get(robot), prediction.sides
        if expected is None:
            problem = among(others, {})
            alone = self._alone.drive({robot: among({}, {})})[robot]
            ways = {robot: alone.states[0, :, :2], **others}
            sides = agreed_sides(self._scene, ways, memory.sigma_m)
        problem = among(others, sides)
        if self._arrives_early:
            solution = self._early(problem, expected, as_if_alone)
            held = goal is true_goal and (is_deadlock(problem, solution) or rests_beside(problem, solution, self._scene.arrival_tolerance))
            self._yielding.judge(memory, held)
        else:
            start = expected or self._starts.start(problem, [robot], otherwise=as_if_alone)
            solution = solve_well(self._solver, problem, start, as_if_alone, self._deadline)
        solution = self._inside(problem, solution, room)
        self._starts.keep([robot], solution)
        self._last = np.concatenate([solution.states[0, 1:], solution.states[0, -1:]]) if solution.solved else None
        return Plan(solution.inputs[0], solution.states[0], solution.solved)

    def _early(
        self, problem: JointProblem, expected: Start | None, as_if_alone: Callable[[], Start]
    ) -> Solution:
        """A plan that is at its goal as early as can be."""
        goal, tolerance = problem.goals[0], self._scene.arrival_tolerance

        def solved(start: Start, known: Array) -> Solution:
            weights = arrival_weights(problem.weights, known, goal, 0.5 * tolerance)
            return self._solver.solve(replace(problem, weights=weights), start)

        def cost(solution: Solution) -> tuple[bool, bool, float]:
            away = np.linalg.norm(solution.states[0] - goal, axis=1) > tolerance
            excess = solution.violation_m / problem.size_m
            count = float(away.sum()) + problem.steps * excess
            return not solution.solved, excess > POOR, count + 1e-3 * stages_away(solution.states[0], goal, 0.5 * tolerance)

        def is_poor(solution: Solution) -> bool:
            return not solution.solved or solution.violation_m > POOR * problem.size_m

        other = expected or as_if_alone()
        start = self._starts.start(problem, [self._robot], otherwise=lambda: other)
        known = self._last
        if known is None or not start.warm:
            known = problem.rollout(start.inputs)[0]
        found = solved(start, known)
        if start.warm and (is_poor(found) or is_deadlock(problem, found)) and not self._deadline.has_passed():
            for make in (lambda: other, as_if_alone):
                begin = make()
                found = min(found, solved(begin, problem.rollout(begin.inputs)[0]), key=cost)
                if not is_poor(found) and not is_deadlock(problem, found):
                    break
        if rests_beside(problem, found, tolerance):
            for make in manoeuvres(problem):
                if self._deadline.has_passed():
                    break
                begin = make()
                known = problem.rollout(begin.inputs)[0]
                known[-1 - problem.steps // 4 :] = goal
                candidate = solved(begin, known)
                candidate = solved(candidate.start(), candidate.states[0])
                found = min(found, candidate, key=cost)
        return found

    def _inside(self, problem: JointProblem, solution: Solution, room: Room) -> Solution:
        """The plan, or one near it whose first input the lines allow."""
        allowed = room(solution.inputs[0, 0]) if solution.solved else None
        if allowed is None:
            return solution
        weights = problem.weights
        if self._arrives_early:
            weights = arrival_weights(weights, solution.states[0], problem.goals[0], 0.5 * self._scene.arrival_tolerance)
        bounded = replace(problem, first_inputs=np.array([allowed]), weights=weights)
        found = self._solver.solve(bounded, solution.start())
        return found if found.solved else solution


class JointPlan:
    """Plans for one robot where goals are exchanged: the joint problem is its plan."""

    def __init__(self, robot: str, planner: Planner) -> None:
        self._robot = robot
        self._planner = planner

    def plan(
        self, memory: Memory, goal: Array, previous: Input, prediction: Prediction, room: Room
    ) -> Plan:
        """Its own part of the prediction; planned anew among the others where that is not allowed."""
        robot = self._robot
        if room(prediction.inputs[robot][0]) is not None:
            return self._planner.plan(memory, goal, previous, prediction, room)
        return Plan(prediction.inputs[robot], prediction.states[robot], prediction.solved)
