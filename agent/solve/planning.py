"""Plan: the ego's own problem with its true goal, the others moving as predicted (eq. 1)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.prediction import Prediction
from agent.solve.problem import JointProblem, JointSolver, Solution, Start, joint_problem
from agent.solve.sides import Sides, agreed_sides
from agent.solve.starts import Alone, WarmStarts, cold_start, solve_well
from agent.solve.vehicle import Array
from protocol.scene import Scene
from protocol.vehicle import Input, Reachable

Room = Callable[[Array], Reachable | None]
"""Where a planned first input (2,) is not allowed, a range of inputs that are; else None."""


@dataclass(frozen=True)
class Plan:
    """What the ego means to do: inputs (n, 2), at least one, and the states (n + 1, 4) they lead through."""

    inputs: Array
    states: Array
    solved: bool


class Task(NamedTuple):
    """What is to be solved for the ego, and where to begin."""

    problem: JointProblem
    expected: Start | None
    """Its own part of the prediction."""
    as_if_alone: Callable[[], Start]
    """What it would do if nobody else were there."""


class Planner:
    """Plans for one robot by eq. 1.

    Each plan starts from the self-prediction, so that the ego passes the others where they expect it. Where
    there is none, it starts from the last plan, one step on. A plan that violates a distance, or stands
    before somebody for good, is compared with one that starts from what the ego would do if it were alone.
    A plan whose first input the reserve does not allow is made anew within what it allows.

    Args:
        scene: what everybody may know.
        robot: the ego.
        solver: of trajectory problems.
        deadline: after it nothing is improved.
    """

    def __init__(self, scene: Scene, robot: str, solver: JointSolver, deadline: Deadline) -> None:
        self._scene = scene
        self._robot = robot
        self._solver = solver
        self._deadline = deadline
        self._starts = WarmStarts()
        self._alone = Alone(solver)

    def plan(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction, room: Room) -> Plan:
        """Solve eq. 1 for the ego, among the predicted paths of all others.

        Args:
            memory: the present.
            goal: its own goal state, shape (4,).
            previous: its last input.
            prediction: of all robots.
            room: what the reserve allows.
        """
        task = self._task(memory, goal, previous, prediction)
        solution = self._within(room, task.problem, self._solved(task))
        self._starts.keep([self._robot], solution)
        return Plan(solution.inputs[0], solution.states[0], solution.solved)

    def _task(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction) -> Task:
        robot, present = self._robot, memory.present()
        others = {other: path for other, path in prediction.paths.items() if other != robot}
        cautions_m = {other: self._caution_m(memory, other) for other in others}

        def among(paths: Mapping[str, Array], sides: Sides) -> JointProblem:
            inputs = {robot: previous}
            return joint_problem(self._scene, present, {robot: goal}, paths, inputs, cautions_m, sides)

        alone: Solution | None = None

        def driven_alone() -> Solution:
            nonlocal alone
            alone = alone or self._alone.drive({robot: among({}, {})})[robot]
            return alone

        expected, sides = prediction.starts.get(robot), prediction.sides
        if expected is None:
            ways = {robot: driven_alone().states[0, :, :2], **others}
            sides = agreed_sides(self._scene, ways, memory.sigma_m)
        problem = among(others, sides)
        return Task(problem, expected, lambda: cold_start(problem, driven_alone().inputs.copy()))

    def _caution_m(self, memory: Memory, other: str) -> float:
        """How much more than the safety distance to keep from another robot."""
        return memory.caution_m(other)

    def _solved(self, task: Task) -> Solution:
        start = task.expected or self._starts.start(task.problem, [self._robot], otherwise=task.as_if_alone)
        return solve_well(self._solver, task.problem, start, task.as_if_alone, self._deadline)

    def _within(self, room: Room, problem: JointProblem, solution: Solution) -> Solution:
        """The solution, or one near it whose first input is allowed."""
        allowed = room(solution.inputs[0, 0]) if solution.solved else None
        if allowed is None:
            return solution
        bounded = replace(self._weighted(problem, solution.states[0]), first_inputs=np.array([allowed]))
        found = self._solver.solve(bounded, solution.start())
        return found if found.solved else solution

    def _weighted(self, problem: JointProblem, known: Array) -> JointProblem:
        """The problem with the weights of the plan, about known states (K + 1, 4)."""
        return problem


class JointPlan:
    """Plans for one robot where goals are exchanged: the joint problem is its plan."""

    def __init__(self, robot: str, planner: Planner) -> None:
        self._robot = robot
        self._planner = planner

    def plan(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction, room: Room) -> Plan:
        """Its own part of the prediction; made anew among the others where the reserve does not allow it."""
        robot = self._robot
        if room(prediction.inputs[robot][0]) is not None:
            return self._planner.plan(memory, goal, previous, prediction, room)
        return Plan(prediction.inputs[robot], prediction.states[robot], prediction.solved)
