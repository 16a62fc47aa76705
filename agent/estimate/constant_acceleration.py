"""The simple prediction model: a robot goes on accelerating, and its goal is where that leads."""

import numpy as np

from agent.estimate.goals import goal_inside
from agent.remember.memory import Memory
from agent.solve.compiled import kernel
from agent.solve.vehicle import Array
from protocol.scene import Scene


class ConstantAcceleration:
    """Applies the maximum jerk within the limits over the prediction horizon; its end is the goal estimate.

    The publication's baseline, and its stand-in until enough states were seen for inverse optimal control.
    """

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimate.goals.GoalEstimator`."""
        return {robot: self.estimate_one(memory, robot) for robot in memory.robots}

    def estimate_one(self, memory: Memory, robot: str) -> Array:
        """The goal estimate of one robot, shape (4,), inside the drivable area."""
        end, heading = self.path(memory, robot)[-1], memory.state(robot)[2]
        return goal_inside(self._scene.area, np.array([*end, heading]))

    def path(self, memory: Memory, robot: str) -> Array:
        """Positions (K + 1, 2) of one robot at the present and the next K stages, in the area or not."""
        limits = self._scene.robot(robot).limits
        acceleration = memory.previous_input(robot).acceleration_mps2
        highest = (limits.speed_mps, limits.acceleration_mps2, limits.jerk_mps3)
        steps, step_s = self._scene.horizons.prediction_steps, self._scene.step_s
        return _speeding_up(memory.state(robot), acceleration, highest, steps, step_s)


@kernel
def _speeding_up(
    state: Array, acceleration: float, highest: tuple[float, float, float], steps: int, step_s: float
) -> Array:
    """Positions (K + 1, 2) straight on, ever faster up to the highest speed, acceleration and jerk."""
    x, y, heading, speed = state
    speed_limit, acceleration_limit, jerk_limit = highest
    positions = np.empty((steps + 1, 2))
    positions[0] = state[:2]
    direction = -1.0 if speed < 0.0 else 1.0
    way = 0.0
    for k in range(1, steps + 1):
        way += step_s * speed
        positions[k, 0] = x + way * np.cos(heading)
        positions[k, 1] = y + way * np.sin(heading)
        faster = direction * acceleration + jerk_limit * step_s
        room = (speed_limit - direction * speed) / step_s
        acceleration = direction * min(faster, acceleration_limit, room)
        speed += step_s * acceleration
    return positions
