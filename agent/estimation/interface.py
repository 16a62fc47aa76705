"""The interface of all goal estimators."""

from typing import Protocol

import numpy as np

from agent.memory import Memory
from agent.vehicle import Array
from protocol.scene import Area


class GoalEstimator(Protocol):
    """Estimates the goal state of every robot in memory, the ego as the others see it included."""

    goals_are_shared: bool
    """Whether the estimates are everybody's true goals; the joint prediction is then the plan."""

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """Goal states (p_x, p_y, ψ, 0), shape (4,), each heading within half a turn of the present one."""
        ...


def goal_inside(area: Area, goal: Array) -> Array:
    """A goal state with its position moved into the drivable area and its speed zero, shape (4,)."""
    x = min(max(goal[0], area.x_min_m), area.x_max_m)
    y = min(max(goal[1], area.y_min_m), area.y_max_m)
    return np.array([x, y, goal[2], 0.0])
