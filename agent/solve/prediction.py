"""Predict: the joint problem of everybody with the estimated goals (eq. 7), or each other robot by itself."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.problem import JointProblem, JointSolver, Solution, Start, joint_problem
from agent.solve.sides import Sides, agreed_sides
from agent.solve.starts import ALIKE, POOR, Alone, WarmStarts, openings_of, rank
from agent.solve.vehicle import Array
from protocol.scene import Scene
from protocol.vehicle import Input

PathModel = Callable[[Memory, str], Array]
"""Positions (K + 1, 2) of one robot at the present and the next K stages."""


@dataclass(frozen=True)
class Prediction:
    """What all robots will do, as everybody may think: the ego drives to its *estimated* goal here."""

    paths: dict[str, Array]
    """Positions (K + 1, 2) of every robot."""
    inputs: dict[str, Array]
    """Inputs (K, 2) of every robot that is not parked."""
    starts: dict[str, Start]
    """Where the planning of a robot that is not parked may start: from its own part of the prediction."""
    states: dict[str, Array]
    """States (K + 1, 4) of every robot that is not parked."""
    sides: Sides
    """On which sides pairs pass one another, where that is agreed."""
    solved: bool


class Predictor:
    """Predicts all robots jointly, each time from the last prediction.

    Where everybody sees everything exactly, all come to the same prediction, and so agree on who passes whom
    on which side. Where they may see differently, all keep to the sides that all can see, unless these cannot
    be kept together.
    """

    def __init__(self, scene: Scene, solver: JointSolver, deadline: Deadline) -> None:
        self._scene = scene
        self._solver = solver
        self._deadline = deadline
        self._starts = WarmStarts()
        self._alone = Alone(solver)

    def predict(self, memory: Memory, goals: Mapping[str, Array], parked: Collection[str]) -> Prediction:
        """Solve eq. 7 for all robots in memory; those known to be parked stay where they are."""
        scene = self._scene
        stages = scene.horizons.prediction_steps + 1
        resting = {
            robot: np.tile(memory.state(robot)[:2], (stages, 1)) for robot in memory.robots if robot in parked
        }
        free = {robot: goals[robot] for robot in memory.robots if robot not in parked}
        inputs = {robot: memory.previous_input(robot) for robot in free}
        problem = joint_problem(scene, memory.present(), free, resting, inputs)
        solution = self._solve(problem, list(free))
        sides: Sides = {}
        if not all(map(memory.is_certain, free)) and not self._deadline.has_passed():
            sides = agreed_sides(scene, self._ways_alone(memory, free, inputs) | resting, memory.sigma_m)
            problem = joint_problem(scene, memory.present(), free, resting, inputs, sides=sides)
            kept = self._on_sides(problem, solution)
            solution, sides = (solution, {}) if kept is None else (kept, sides)
        self._starts.keep(list(free), solution)
        moving = dict(zip(free, solution.states, strict=True))
        return Prediction(
            paths={robot: states[:, :2] for robot, states in moving.items()} | resting,
            inputs=dict(zip(free, solution.inputs, strict=True)),
            starts={robot: solution.start(slice(index, index + 1)) for index, robot in enumerate(free)},
            states=moving,
            sides=sides,
            solved=solution.solved,
        )

    def _solve(self, problem: JointProblem, robots: list[str]) -> Solution:
        """From the last solution; without one, the best from several openings, as time allows."""
        first, *others = openings_of(problem)
        start = self._starts.start(problem, robots, otherwise=first)
        found = self._solver.solve(problem, start)
        for opening in () if start.warm else others:
            if self._deadline.has_passed():
                break
            other = self._solver.solve(problem, self._starts.start(problem, robots, otherwise=opening))
            if rank(problem, other, ALIKE) < rank(problem, found):
                found = other
        return found

    def _ways_alone(
        self, memory: Memory, goals: Mapping[str, Array], inputs: Mapping[str, Input]
    ) -> dict[str, Array]:
        """The positions (K + 1, 2) of each robot as if it were alone."""
        present = memory.present()
        own = {
            robot: joint_problem(self._scene, present, {robot: goal}, {}, {robot: inputs[robot]})
            for robot, goal in goals.items()
        }
        return {robot: solution.states[0, :, :2] for robot, solution in self._alone.drive(own).items()}

    def _on_sides(self, problem: JointProblem, solution: Solution) -> Solution | None:
        """A solution of the problem with sides: the given one, or one near it; None if none is found."""
        if problem.violation_m(solution.states) <= POOR * problem.size_m:
            return solution
        for warm in (True, False):
            found = self._solver.solve(problem, solution.start(warm=warm))
            if found.solved and found.violation_m <= POOR * problem.size_m:
                return found
            if self._deadline.has_passed():
                break
        return None


class IndependentPredictor:
    """Predicts each other robot by a model of its motion: nobody makes way for anybody (the baselines).

    The ego is not predicted, and left to plan from its own last plan.
    """

    def __init__(self, robot: str, path: PathModel) -> None:
        self._robot = robot
        self._path = path

    def predict(self, memory: Memory, goals: Mapping[str, Array], parked: Collection[str]) -> Prediction:
        """The paths of the others; neither goals nor who is parked are known to these models."""
        others = [robot for robot in memory.robots if robot != self._robot]
        paths = {robot: self._path(memory, robot) for robot in others}
        return Prediction(paths=paths, inputs={}, starts={}, states={}, sides={}, solved=True)
