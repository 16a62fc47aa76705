"""The simple prediction model: a robot goes on accelerating, and its goal is where that leads."""

import numpy as np

from agent.estimation.interface import goal_inside
from agent.memory import Memory
from agent.vehicle import Array, rollout
from protocol.scene import Scene


class ConstantAcceleration:
    """Applies the maximum jerk within the limits over the prediction horizon; its end is the goal estimate.

    The publication's baseline, and its stand-in until enough states were seen for inverse optimal control.
    """

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimation.interface.GoalEstimator`."""
        return {robot: self.estimate_one(memory, robot) for robot in memory.robots}

    def estimate_one(self, memory: Memory, robot: str) -> Array:
        """The goal estimate of one robot, shape (4,), inside the drivable area."""
        inputs = self._speeding_up(memory, robot)
        end = rollout(memory.state(robot), inputs, self._scene.step_s)[-1]
        return goal_inside(self._scene.area, end)

    def _speeding_up(self, memory: Memory, robot: str) -> Array:
        """Inputs of shape (K, 2): ever faster in the direction of motion, straight on, up to the limits."""
        limits, step_s = self._scene.robot(robot).limits, self._scene.step_s
        speed, acceleration = memory.state(robot)[3], memory.previous_input(robot).acceleration_mps2
        direction = -1.0 if speed < 0 else 1.0
        inputs = np.zeros((self._scene.horizons.prediction_steps, 2))
        for control in inputs:
            faster = direction * acceleration + limits.jerk_mps3 * step_s
            room = (limits.speed_mps - direction * speed) / step_s
            acceleration = direction * min(faster, limits.acceleration_mps2, room)
            speed += step_s * acceleration
            control[1] = acceleration
        return inputs
