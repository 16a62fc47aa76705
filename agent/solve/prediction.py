"""Predict: the joint problem of everybody with the estimated goals (eq. 7), or each other robot by itself."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.multistart import WarmStarts, best_solution, cold_starts
from agent.solve.problem import JointProblem, JointSolver, Start, joint_problem
from agent.solve.vehicle import Array
from protocol.scene import Scene

PathModel = Callable[[Memory, str], Array]
"""Positions (K + 1, 2) of one robot at the present and the next K stages."""

RETRY_STEPS = 2
"""Where robots may see differently, a cold start is tried every so many steps, each of them in turn."""


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
    solved: bool


class Predictor:
    """Predicts all robots jointly, each time from the last prediction."""

    def __init__(self, scene: Scene, solver: JointSolver, deadline: Deadline) -> None:
        self._scene = scene
        self._solver = solver
        self._deadline = deadline
        self._starts = WarmStarts()

    def predict(self, memory: Memory, goals: Mapping[str, Array], parked: Collection[str]) -> Prediction:
        """Solve eq. 7 for all robots in memory; those known to be parked stay where they are."""
        stages = self._scene.horizons.prediction_steps + 1
        resting = {
            robot: np.tile(memory.state(robot)[:2], (stages, 1)) for robot in memory.robots if robot in parked
        }
        free = {robot: goals[robot] for robot in memory.robots if robot not in parked}
        inputs = {robot: memory.previous_input(robot) for robot in free}
        problem = joint_problem(self._scene, memory.present(), free, resting, inputs)
        starts = self._starts.starts(problem, list(free))
        if len(starts) == 1 and not all(map(memory.is_certain, free)):
            starts += another_start(problem, memory.step)
        solution = best_solution(self._solver, problem, starts, self._deadline)
        if solution.solved:
            self._starts.keep(list(free), solution)
        else:
            self._starts.forget()
        moving = dict(zip(free, solution.states, strict=True))
        return Prediction(
            paths={robot: states[:, :2] for robot, states in moving.items()} | resting,
            inputs=dict(zip(free, solution.inputs, strict=True)),
            starts={robot: solution.start(slice(index, index + 1)) for index, robot in enumerate(free)},
            states=moving,
            solved=solution.solved,
        )


def another_start(problem: JointProblem, step: int) -> list[Start]:
    """Where else to look for a prediction when robots may see differently: at some steps a cold start.

    They may begin with different ideas of who passes whom on which side, and from its last solution each
    would hold on to its own, up to a collision. All try the same start at the same step.
    """
    turn, rest = divmod(step, RETRY_STEPS)
    if rest:
        return []
    starts = cold_starts(problem)
    return [starts[turn % len(starts)]]


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
        return Prediction(paths=paths, inputs={}, starts={}, states={}, solved=True)
