"""Predict: the joint problem of everybody with the estimated goals (eq. 7), or each other robot by itself."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.problem import JointSolver, Start, joint_problem
from agent.solve.sides import Sides, agreed_sides
from agent.solve.starts import Alone, WarmStarts, cold_start, solve_well
from agent.solve.vehicle import Array
from protocol.scene import Scene

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
    """Predicts all robots jointly, each time from the last prediction, and all on the sides agreed on."""

    def __init__(self, scene: Scene, solver: JointSolver, deadline: Deadline) -> None:
        self._scene = scene
        self._solver = solver
        self._deadline = deadline
        self._starts = WarmStarts()
        self._alone = Alone(solver)

    def predict(self, memory: Memory, goals: Mapping[str, Array], parked: Collection[str]) -> Prediction:
        """Solve eq. 7 for all robots in memory; those known to be parked stay where they are."""
        scene, present = self._scene, memory.present()
        stages = scene.horizons.prediction_steps + 1
        resting = {
            robot: np.tile(memory.state(robot)[:2], (stages, 1)) for robot in memory.robots if robot in parked
        }
        free = {robot: goals[robot] for robot in memory.robots if robot not in parked}
        inputs = {robot: memory.previous_input(robot) for robot in free}
        alone = self._alone.drive(
            {
                robot: joint_problem(scene, present, {robot: goal}, {}, {robot: inputs[robot]})
                for robot, goal in free.items()
            }
        )
        ways = {robot: each.states[0, :, :2] for robot, each in alone.items()} | resting
        sides = agreed_sides(scene, ways, {robot: memory.sigma_m(robot) for robot in ways})
        problem = joint_problem(scene, present, free, resting, inputs, sides=sides)

        def as_if_alone() -> Start:
            return cold_start(problem, np.array([each.inputs[0] for each in alone.values()]))

        start = self._starts.start(problem, list(free), otherwise=as_if_alone)
        solution = solve_well(self._solver, problem, start, as_if_alone, self._deadline)
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
