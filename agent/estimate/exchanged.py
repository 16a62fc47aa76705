"""No goals at all: for methods that predict motions without asking where they lead."""

import numpy as np

from agent.estimate.interface import known_goal
from agent.remember.memory import Memory
from agent.solve.vehicle import Array
from protocol.scene import Goal, Scene


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
        """See :class:`agent.estimate.interface.GoalEstimator`."""
        estimates = {}
        for robot in memory.robots:
            state = memory.state(robot)
            if robot in self._goals:
                estimates[robot] = known_goal(self._goals[robot], state)
            else:
                estimates[robot] = np.array([*state[:3], 0.0])
        return estimates


class Unestimated:
    """Estimates nothing."""

    goals_are_shared = False

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimate.interface.GoalEstimator`."""
        return {}
