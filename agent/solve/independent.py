"""Predict each other robot alone by a model of its motion: nobody makes way for anybody (the baselines)."""

from collections.abc import Callable, Collection, Mapping

import numpy as np

from agent.remember.memory import Memory
from agent.solve.prediction import Prediction
from agent.solve.vehicle import Array, rollout
from protocol.scene import Scene

PathModel = Callable[[Memory, str], Array]
"""Positions (K + 1, 2) of one robot at the present and the next K stages."""


class IndependentPredictor:
    """Predicts the others one by one, and not the ego, which is left to plan from its own last plan."""

    def __init__(self, robot: str, path: PathModel) -> None:
        self._robot = robot
        self._path = path

    def predict(self, memory: Memory, goals: Mapping[str, Array], parked: Collection[str]) -> Prediction:
        """The paths of the others; neither goals nor who is parked are known to these models."""
        others = [robot for robot in memory.robots if robot != self._robot]
        paths = {robot: self._path(memory, robot) for robot in others}
        return Prediction(paths=paths, inputs={}, starts={}, states={}, solved=True)


class ConstantVelocity:
    """A robot goes on as it is: its speed and its heading stay what they are."""

    def __init__(self, scene: Scene) -> None:
        self._no_input = np.zeros((scene.horizons.prediction_steps, 2))
        self._step_s = scene.step_s

    def path(self, memory: Memory, robot: str) -> Array:
        """Positions (K + 1, 2) at the present and the next K stages."""
        return rollout(memory.state(robot), self._no_input, self._step_s)[:, :2]
