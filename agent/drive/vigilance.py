"""Vigilance: whom a robot does not see although it should, and when it has to stop for that."""

import numpy as np

from agent.remember.memory import MOST_CAUTION_M, Memory
from agent.solve.vehicle import Array, velocity
from protocol.scene import Scene

BLIND_STEPS = 5
"""For so long others are extrapolated; then the robot stops, if one of them could be in its way."""
GONE_STEPS = 30
"""A robot that has not been seen for so long is taken to have left; then the way is free again."""


class Vigilance:
    """Remembers everybody that was seen lately.

    Args:
        scene: limits and distances.
        robot: who looks.
    """

    def __init__(self, scene: Scene, robot: str) -> None:
        self._scene = scene
        self._robot = robot
        self._last: dict[str, tuple[int, Array]] = {}

    def look(self, memory: Memory, age_steps: int = 0) -> None:
        """Take in who was seen; to be called once a step.

        Args:
            memory: with what is seen now.
            age_steps: how old the view of the others is: who was seen so long ago is seen.
        """
        for robot in memory.robots:
            if robot != self._robot:
                seen_step = min(memory.step, memory.step - memory.unseen_steps(robot) + age_steps)
                self._last[robot] = seen_step, memory.state(robot).copy()
        self._last = {
            robot: (seen_step, state)
            for robot, (seen_step, state) in self._last.items()
            if memory.step - seen_step <= GONE_STEPS
        }

    def is_blind(self, memory: Memory) -> bool:
        """Whether somebody that was not seen for long could be in the way: then the robot has to stop."""
        return any(
            memory.step - seen_step > BLIND_STEPS and self._could_meet(memory, robot, state)
            for robot, (seen_step, state) in self._last.items()
        )

    def _could_meet(self, memory: Memory, robot: str, state: Array) -> bool:
        own = memory.state(self._robot)
        apart = state[:2] - own[:2]
        distance_m = float(np.hypot(*apart))
        safety_m = self._scene.safety_distance_m(self._robot, robot) + MOST_CAUTION_M
        if distance_m < safety_m:
            return True
        approaches = float((velocity(state) - velocity(own)) @ apart) < 0.0
        reach_m = self._stopping_m(self._robot, own) + self._stopping_m(robot, state)
        return approaches and distance_m < safety_m + reach_m

    def _stopping_m(self, robot: str, state: Array) -> float:
        """About how far a robot drives until it stands."""
        limits, speed_mps = self._scene.robot(robot).limits, abs(float(state[3]))
        ramp_s = limits.acceleration_mps2 / limits.jerk_mps3
        return speed_mps * ramp_s + speed_mps**2 / (2.0 * limits.acceleration_mps2)
