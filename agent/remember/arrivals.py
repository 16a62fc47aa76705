"""Who has arrived: this robot at its goal, and others where all goals are known."""

from collections.abc import Mapping

from agent.remember.memory import Memory
from protocol.scene import Goal, Scene
from protocol.vehicle import has_arrived


class Arrivals:
    """Judges arrivals by what is remembered.

    Whoever was seen to arrive without noise has arrived for good, and stays parked in the way of the others;
    under noise it may only have looked like that, and counts as long as it does.
    """

    def __init__(self, scene: Scene, robot: str, memory: Memory) -> None:
        self._tolerance = scene.arrival_tolerance
        self._robot = robot
        self._memory = memory
        self._reached: Goal | None = None
        self._parked: set[str] = set()

    def has_arrived(self, goal: Goal) -> bool:
        """Whether this robot is, or exactly seen was, at its goal."""
        for_good = self._reached == goal and self._memory.is_exact(self._robot)
        arrived = for_good or self._is_at(goal, self._robot)
        self._reached = goal if arrived else None
        return arrived

    def parked(self, goals: Mapping[str, Goal]) -> set[str]:
        """Those of the other robots that have arrived at these goals."""
        present = set(self._memory.robots)
        self._parked -= {robot for robot in present if not self._memory.is_exact(robot)}
        others = present & goals.keys() - {self._robot}
        self._parked |= {robot for robot in others if self._is_at(goals[robot], robot)}
        return self._parked & present

    def _is_at(self, goal: Goal, robot: str) -> bool:
        return has_arrived(self._memory.state(robot).tolist(), goal.as_state(), self._tolerance)
