"""The interface of all goal estimators."""

from typing import Protocol

import numpy as np

from agent.remember.memory import Memory
from agent.solve.vehicle import Array
from protocol.arrival import nearest_turn
from protocol.scene import Area, Goal


class GoalEstimator(Protocol):
    """Estimates the goal state of every robot in memory, the ego as the others see it included."""

    goals_are_shared: bool
    """Whether the estimates are everybody's true goals; the joint prediction is then the plan."""

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """Goal states (p_x, p_y, ψ, 0), shape (4,), each heading within half a turn of the present one."""
        ...


def goal_inside(area: Area, pose: Array) -> Array:
    """A pose (p_x, p_y, ψ, …) as a goal state, its position moved into the drivable area, shape (4,)."""
    x = min(max(pose[0], area.x_min_m), area.x_max_m)
    y = min(max(pose[1], area.y_min_m), area.y_max_m)
    return np.array([x, y, pose[2], 0.0])


def known_goal(goal: Goal, present: Array) -> Array:
    """A known goal as a state, its heading within half a turn of that of the present state, shape (4,)."""
    x, y, heading, speed = goal.as_state()
    return np.array([x, y, nearest_turn(heading, present[2]), speed])
