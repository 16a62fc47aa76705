"""A way out of a stop: of robots that stand and hold one another up, one after the other backs off.

Whoever stands is thought to have arrived, so two robots that each stand in the other's way would stand for
good, though each knows of itself that it has not. What all can see is who stands and for how long. So a robot
that stands, wants to go on and cannot, waits until it is sure of that, and longer the later its id comes
among those that stand around it; then it backs off, and for as long again it keeps one safety margin instead
of two from who stands. The others see it drive, and that the way is free, or that it has not arrived; their
waiting begins anew.
"""

import math

import numpy as np

from agent.remember.memory import Memory
from agent.solve.vehicle import Array
from protocol.scene import Scene

SURE_STEPS = 10
"""Who has been in one place for so long, stands."""
PLACE = 0.25
"""In safety distances: so far about a robot may try to find a way, and stand none the less."""
TURN_STEPS = 5
"""In so many steps all see that somebody has begun to back off; then it is not the turn of the next one."""
ROOM = 2.0
"""In safety distances: so far a robot backs off, and those that stand within it are around it."""


class Yielding:
    """Decides where one robot drives for now: to its goal, or out of the way.

    Args:
        scene: what everybody may know.
        robot: this robot's id.
    """

    def __init__(self, scene: Scene, robot: str) -> None:
        self._scene = scene
        self._robot = robot
        self._room_m = ROOM * scene.safety_distance_m(robot, robot)
        limits = scene.robot(robot).limits
        way_s = 2.0 * math.sqrt(self._room_m / limits.acceleration_mps2)
        way_s += limits.acceleration_mps2 / limits.jerk_mps3 + self._room_m / limits.speed_mps
        self._way_steps = math.ceil(way_s / scene.step_s)
        self._waited_steps = 0
        self._refuge: Array | None = None
        self._began = -2 * self._way_steps

    def destination(self, memory: Memory, goal: Array) -> Array:
        """The state (4,) to plan for: the goal, or a place out of the way."""
        if self._refuge is not None and memory.step < self._began + self._way_steps:
            return self._refuge
        self._refuge = None
        return goal

    def concession_m(self, memory: Memory, other: str) -> float:
        """How much less than the safety distance to keep from another robot for now."""
        is_over = memory.step >= self._began + 2 * self._way_steps
        return 0.0 if is_over or not self._stands(other, memory) else self._scene.safety_margin_m

    def judge(self, memory: Memory, is_held_up: bool) -> None:
        """Take in, once a step, whether the plan comes to rest before the goal; begin to back off, if due."""
        around = [*self._around(memory), self._robot]
        is_stuck = is_held_up and len(around) > 1 and all(self._stands(robot, memory) for robot in around)
        if self._refuge is not None or not is_stuck:
            self._waited_steps = 0
            return
        self._waited_steps += 1
        if self._waited_steps >= SURE_STEPS + TURN_STEPS * sorted(around).index(self._robot):
            self._refuge, self._began = self._away_from(around, memory), memory.step
            self._waited_steps = 0

    def _around(self, memory: Memory) -> list[str]:
        own = memory.state(self._robot)[:2]
        return [
            other
            for other in memory.robots
            if other != self._robot
            and math.dist(memory.state(other)[:2], own)
            < ROOM * self._scene.safety_distance_m(self._robot, other)
        ]

    def _stands(self, robot: str, memory: Memory) -> bool:
        """Whether it has been in one place for long enough, give or take what it tries."""
        way = memory.states(robot, SURE_STEPS)[:, :2] - memory.state(robot)[:2]
        place_m = PLACE * self._scene.safety_distance_m(robot, self._robot)
        return bool(np.linalg.norm(way, axis=1).max() <= place_m)

    def _away_from(self, around: list[str], memory: Memory) -> Array:
        """Straight ahead or back, whichever leads away from the others; inside the area."""
        x, y, heading, _ = memory.state(self._robot)
        along = np.array([math.cos(heading), math.sin(heading)])
        apart = np.array([np.array([x, y]) - memory.state(other)[:2] for other in around]).sum(axis=0)
        x, y = np.array([x, y]) + math.copysign(self._room_m, float(along @ apart)) * along
        area = self._scene.area
        x, y = min(max(x, area.x_min_m), area.x_max_m), min(max(y, area.y_min_m), area.y_max_m)
        return np.array([x, y, heading, 0.0])
