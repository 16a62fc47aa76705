"""A way out of a stop: of robots that stand and hold one another up, one after the other backs off.

Whoever stands is thought to have arrived, so two robots that each stand in the other's way would stand for
good, though each knows of itself that it has not. What all can see is who stands and for how long. So a robot
that stands, wants to go on and cannot, waits until it is sure of that, and longer the later its id comes among
those that stand around it; then it backs off. The others see it drive, and that the way is free, or that it
has not arrived; their waiting begins anew.
"""

import math

import numpy as np

from agent.remember.memory import Memory
from agent.solve.vehicle import Array
from protocol.scene import Scene

SURE_STEPS = 10
"""For so long a robot has stood that is taken to stand."""
PLACE = 0.25
"""In safety distances: so far about a robot may try to find a way, and stand none the less."""
TURN_STEPS = 5
"""In so many steps all see that somebody has begun to back off; then it is not the turn of the next one."""
ROOM = 2.0
"""In safety distances: so far a robot backs off, and those that stand within it are around it."""


class Yielding:
    """Decides where one robot drives for now: to its goal, or out of the way."""

    def __init__(self, scene: Scene, robot: str) -> None:
        self._scene = scene
        self._robot = robot
        limits = scene.robot(robot).limits
        self._room_m = ROOM * scene.safety_distance_m(robot, robot)
        way_s = 2.0 * math.sqrt(self._room_m / limits.acceleration_mps2)
        way_s += limits.acceleration_mps2 / limits.jerk_mps3 + self._room_m / limits.speed_mps
        self._way_steps = math.ceil(way_s / scene.step_s)
        self._stood_steps = 0
        self._refuge: Array | None = None
        self._until = 0

    def destination(self, memory: Memory, goal: Array) -> Array:
        """The state (4,) to plan for: the goal, or where this robot is out of the way."""
        if self._refuge is not None and memory.step < self._until:
            return self._refuge
        self._refuge = None
        return goal

    def judge(self, memory: Memory, is_held_up: bool) -> None:
        """Take in, once a step, whether the plan for the goal ends before it, for other robots' sake."""
        around = self._around(memory)
        if self._refuge is not None or not is_held_up or not around or not self._stand([*around, self._robot], memory):
            self._stood_steps = 0
            return
        self._stood_steps += 1
        turn = sorted([*around, self._robot]).index(self._robot)
        if self._stood_steps >= SURE_STEPS + TURN_STEPS * turn:
            self._refuge = self._away_from(around, memory)
            self._until = memory.step + self._way_steps
            self._stood_steps = 0

    def _around(self, memory: Memory) -> list[str]:
        own = memory.state(self._robot)[:2]
        return [
            other
            for other in memory.robots
            if other != self._robot
            and math.dist(memory.state(other)[:2], own) < ROOM * self._scene.safety_distance_m(self._robot, other)
        ]

    def _stand(self, robots: list[str], memory: Memory) -> bool:
        """Whether all of them have been in one place for long enough, give or take what they try."""
        for robot in robots:
            way = memory.states(robot, SURE_STEPS)[:, :2] - memory.state(robot)[:2]
            if np.linalg.norm(way, axis=1).max() > PLACE * self._scene.safety_distance_m(robot, self._robot):
                return False
        return True

    def _away_from(self, others: list[str], memory: Memory) -> Array:
        """Straight ahead or back, whichever leads away from the others."""
        x, y, heading, _ = memory.state(self._robot)
        along = np.array([math.cos(heading), math.sin(heading)])
        apart = sum(np.array([x, y]) - memory.state(other)[:2] for other in others)
        way = math.copysign(self._room_m, float(along @ apart)) * along
        area = self._scene.area
        return np.array(
            [
                min(max(x + way[0], area.x_min_m), area.x_max_m),
                min(max(y + way[1], area.y_min_m), area.y_max_m),
                heading,
                0.0,
            ]
        )
