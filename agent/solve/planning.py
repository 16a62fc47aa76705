"""Plan: the ego's own problem with its true goal, the others moving as predicted (eq. 1)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.prediction import Prediction
from agent.solve.problem import JointProblem, JointSolver, Solution, Start, joint_problem
from agent.solve.sides import Sides, agreed_sides
from agent.solve.starts import Alone, WarmStarts, cold_start, solve_well
from agent.solve.vehicle import Array
from protocol.scene import Scene
from protocol.vehicle import Input, Limits

EVENLY = 0.7
"""Part of the highest deceleration at which a robot brakes on average: the rest goes into changing it."""


@dataclass(frozen=True)
class Plan:
    """What the ego means to do: inputs (n, 2), at least one, and the states (n + 1, 4) they lead through."""

    inputs: Array
    states: Array
    solved: bool


class JointPlan:
    """Plans for one robot where goals are exchanged: the joint problem is its plan."""

    def __init__(self, robot: str) -> None:
        self._robot = robot

    def plan(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction) -> Plan:
        """Its own part of the prediction."""
        robot = self._robot
        return Plan(prediction.inputs[robot], prediction.states[robot], prediction.solved)


class Planner:
    """Plans for one robot.

    Each plan starts from the self-prediction, so that the ego passes the others where they expect it. Where
    there is none, it starts from the last plan, one step on. A plan that violates a distance, or stands
    before somebody for good, is compared with one that starts from what the ego would do if it were alone.

    Args:
        scene: what everybody may know.
        robot: the ego.
        solver: of trajectory problems.
        deadline: after it nothing is improved.
        arrives_quickly: whether to use :func:`arrival_weight` instead of the scene's weight of the speed. The
            others cannot know, so they go on predicting by the scene's.
    """

    def __init__(
        self, scene: Scene, robot: str, solver: JointSolver, deadline: Deadline, *, arrives_quickly: bool
    ) -> None:
        self._scene = scene
        self._robot = robot
        self._solver = solver
        self._deadline = deadline
        self._arrives_quickly = arrives_quickly
        self._starts = WarmStarts()
        self._alone = Alone(solver)

    def plan(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction) -> Plan:
        """Solve eq. 1 for the ego, among the predicted paths of all others."""
        robot, present = self._robot, memory.present()
        others = {other: path for other, path in prediction.paths.items() if other != robot}
        cautions_m = {other: memory.caution_m(other) for other in others}

        def among(paths: Mapping[str, Array], sides: Sides) -> JointProblem:
            inputs = {robot: previous}
            problem = joint_problem(self._scene, present, {robot: goal}, paths, inputs, cautions_m, sides)
            return self._weighted(problem)

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
        start = expected or self._starts.start(problem, [robot], otherwise=as_if_alone)
        solution = solve_well(self._solver, problem, start, as_if_alone, self._deadline)
        self._starts.keep([robot], solution)
        return Plan(solution.inputs[0], solution.states[0], solution.solved)

    def _weighted(self, problem: JointProblem) -> JointProblem:
        """The problem with the weights of the ego's own plan."""
        if not self._arrives_quickly:
            return problem
        way_m = float(np.hypot(*(problem.goals[0, :2] - problem.states[0, :2])))
        weights = problem.weights.copy()
        weights[3] = min(
            weights[3], arrival_weight(weights[:2].max(), way_m, problem.limits[0], problem.step_s)
        )
        return replace(problem, weights=weights)


def arrival_weight(position_weight: float, way_m: float, limits: Limits, step_s: float) -> float:
    """The weight of the speed with which a robot brakes evenly for its goal.

    The cost q p² + r v² leads to v = p/τ with τ² = r/q: the nearer the goal, the more gently a robot drives.
    Braking evenly, by as much as limits of acceleration and jerk allow on average, it comes from p to a stand
    at p with v² = 2 a p; so at that way τ² = p/2a. A time constant below a step has no meaning.

    Args:
        position_weight: q.
        way_m: p.
        limits: the robot's; half its time to brake at full goes into changing the acceleration.
        step_s: Δt.
    """
    evenly_mps2 = EVENLY * limits.acceleration_mps2
    return position_weight * max(way_m / (2.0 * evenly_mps2), step_s**2)
