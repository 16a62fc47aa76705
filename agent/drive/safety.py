"""When not to follow the plan: others do not keep to the reserve, or cannot be seen.

Of a robot that has crossed a line, nothing is assumed but that it goes on as it does, or that it brakes as
hard as its limits allow.
"""

from collections.abc import Sequence

import numpy as np

from agent.remember.memory import Memory
from agent.solve.planning import Plan
from agent.solve.vehicle import Array, velocity
from protocol.scene import Scene
from protocol.vehicle import Limits

BLIND_STEPS = 5
"""For so long others are extrapolated; then the robot stops, if one of them could be in its way."""
GONE_STEPS = 30
"""A robot that has not been seen for so long is taken to have left; then the way is free again."""


class LastResort:
    """Brakes where going on would end in a collision with a robot that is doubted.

    A robot brakes when, for another one that it doubts, three things are true if that one goes on or if it
    brakes: driven as planned, the collision distance is broken; so it is if one more step is driven and then
    braked; and braking at once keeps a greater distance. So it brakes as late as it can.
    """

    def __init__(self, scene: Scene, robot: str) -> None:
        self._scene = scene
        self._robot = robot

    def must_brake(
        self, memory: Memory, doubted: Sequence[str], plan: Plan, at_once: Array, later: Array
    ) -> bool:
        """Whether to brake now instead of following the plan.

        Args:
            memory: the present.
            doubted: other robots.
            plan: what would be driven.
            at_once: positions (T + 1, 2) of braking now.
            later: those of braking after a step of the plan.
        """
        if not doubted:
            return False
        least_m = np.array([self._scene.collision_distance_m(self._robot, other) for other in doubted])
        steps = min(len(at_once), len(plan.states))
        ways = self._ways(memory, doubted, steps)
        planned = gaps_m(plan.states[:steps, :2], ways, least_m)
        stopping, too_late = gaps_m(at_once, ways, least_m), gaps_m(later, ways, least_m) < 0.0
        return bool(((planned < 0.0) & too_late & (stopping > planned)).any())

    def _ways(self, memory: Memory, others: Sequence[str], steps: int) -> Array:
        """Positions of the others if they go on, and if they brake, shape (2, others, steps, 2)."""
        states = np.array([memory.state(other) for other in others])
        turns = np.array([memory.previous_input(other).turn_rate_radps for other in others])
        braking = np.array([self._scene.robot(other).limits.acceleration_mps2 for other in others])
        step_s = self._scene.step_s
        slowing = (np.zeros(len(others)), braking)
        return np.stack([positions_ahead(states, turns, each, steps, step_s) for each in slowing])


class Vigilance:
    """Watches out for robots that should be seen: when one that could be in the way is not, it is to stop."""

    def __init__(self, scene: Scene, robot: str) -> None:
        self._scene = scene
        self._robot = robot
        self._last: dict[str, tuple[int, Array]] = {}
        """Of everybody seen lately, the step and the state."""

    def look(self, memory: Memory, age_steps: int = 0) -> bool:
        """Take in who was seen, once a step; in a view of an age, who was seen so long ago is seen.

        Returns:
            Whether somebody not seen for long could be in the way, so that the robot has to stop.
        """
        step = memory.step
        for robot in memory.robots:
            if robot != self._robot:
                seen_step = min(step, step - memory.unseen_steps(robot) + age_steps)
                self._last[robot] = seen_step, memory.state(robot).copy()
        self._last = {robot: last for robot, last in self._last.items() if step - last[0] <= GONE_STEPS}
        return any(
            step - seen_step > BLIND_STEPS and self._could_meet(memory, robot, state)
            for robot, (seen_step, state) in self._last.items()
        )

    def _could_meet(self, memory: Memory, robot: str, state: Array) -> bool:
        own = memory.state(self._robot)
        apart = state[:2] - own[:2]
        distance_m = float(np.hypot(*apart))
        safety_m = self._scene.safety_distance_m(self._robot, robot) + memory.most_caution_m(robot)
        approaches = float((velocity(state) - velocity(own)) @ apart) < 0.0
        reach_m = self._stopping_m(self._robot, own) + self._stopping_m(robot, state)
        return distance_m < safety_m or (approaches and distance_m < safety_m + reach_m)

    def _stopping_m(self, robot: str, state: Array) -> float:
        """About how far a robot drives until it stands."""
        limits, speed_mps = self._scene.robot(robot).limits, abs(float(state[3]))
        return speed_mps * _ramp_s(limits) + speed_mps**2 / (2.0 * limits.acceleration_mps2)


def _ramp_s(limits: Limits) -> float:
    """How long it takes to brake at full."""
    return limits.acceleration_mps2 / limits.jerk_mps3


def positions_ahead(
    states: Array, turn_rates_radps: Array, slowing_mps2: Array, steps: int, step_s: float
) -> Array:
    """Where vehicles will be that keep turning as they do and lose speed evenly until they stand.

    From states (n, 4), turn rates (n,) and decelerations (n,), zero for a constant speed; positions
    (n, steps, 2), the present one first.
    """
    times_s = step_s * np.arange(steps)
    headings = states[:, 2, None] + turn_rates_radps[:, None] * times_s
    speeds = np.maximum(np.abs(states[:, 3, None]) - slowing_mps2[:, None] * times_s, 0.0)
    signed = np.copysign(speeds, states[:, 3, None])[:, :-1, None] * step_s
    directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)[:, :-1]
    start = states[:, None, :2]
    return np.concatenate([start, start + np.cumsum(signed * directions, axis=1)], axis=1)


def gaps_m(path: Array, ways: Array, least_m: Array) -> Array:
    """Smallest distances (h, m) of a path (n, 2) from ways of others (h, m, steps, 2), less the least (m,).

    Whoever has come to the end of its path stays there.
    """
    own = path[np.minimum(np.arange(ways.shape[2]), len(path) - 1)]
    gaps: Array = np.linalg.norm(ways - own, axis=-1).min(axis=-1) - least_m
    return gaps
