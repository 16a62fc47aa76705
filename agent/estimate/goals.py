"""What goal estimators give, and the two that estimate nothing: goals are exchanged, or not asked for."""

from typing import Protocol

import numpy as np

from agent.remember.memory import Memory
from agent.solve.vehicle import Array
from protocol.scene import Area, Goal, Scene
from protocol.vehicle import nearest_turn


class GoalEstimator(Protocol):
    """Estimates the goal state of every robot in memory, the ego as the others see it included."""

    goals_are_shared: bool
    """Whether the estimates are everybody's true goals; the joint prediction is then the plan."""

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """Goal states (p_x, p_y, ψ, 0), shape (4,), each heading within half a turn of the present one."""
        ...


class Exchanged:
    """Reads the goals from the scene; a robot whose goal is not in it is taken to stay where it is.

    Raises:
        ValueError: the scene holds no goals, because the world was not started for exchanged goals.
    """

    goals_are_shared = True

    def __init__(self, scene: Scene) -> None:
        if scene.goals is None:
            raise ValueError(
                "the scene holds no goals; exchanged goals need a world started with --exchange-goals"
            )
        self._goals: dict[str, Goal] = scene.goals

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`GoalEstimator`."""
        return {robot: self._goal(robot, memory.state(robot)) for robot in memory.robots}

    def _goal(self, robot: str, state: Array) -> Array:
        return known_goal(self._goals[robot], state) if robot in self._goals else np.array([*state[:3], 0.0])


class Unestimated:
    """Estimates nothing, for baselines that predict motions without asking where they lead."""

    goals_are_shared = False

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`GoalEstimator`."""
        return {}


def goal_inside(area: Area, pose: Array) -> Array:
    """A pose (p_x, p_y, ψ, …) as a goal state, its position moved into the drivable area, shape (4,)."""
    x = min(max(pose[0], area.x_min_m), area.x_max_m)
    y = min(max(pose[1], area.y_min_m), area.y_max_m)
    return np.array([x, y, pose[2], 0.0])


def known_goal(goal: Goal, present: Array) -> Array:
    """A known goal as a state, its heading within half a turn of that of the present state, shape (4,)."""
    x, y, heading, speed = goal.as_state()
    return np.array([x, y, nearest_turn(heading, present[2]), speed])
