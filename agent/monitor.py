"""The last resort: brake where going on would end in a collision, whatever the optimiser thinks.

It trusts no prediction. Of every other robot it assumes that it goes on as it does, and that it brakes as
hard as its limits allow; and of its own it knows that braking must begin in time to end in time.
"""

import math

import numpy as np

from agent.memory import Memory
from agent.planning import Plan
from agent.vehicle import Array, rollout
from protocol.scene import Scene
from protocol.vehicle import Input, Limits, braking_input

LONGEST_S = 10.0
"""No vehicle is looked after for longer, should its limits let it brake that long."""


class CollisionMonitor:
    """Judges each plan before it is driven.

    A robot intervenes when three things are true of another one, if that goes on or if it brakes: driven to
    its end, the plan enters the collision distance; so does the plan's first step followed by braking; and
    braking at once keeps a greater distance. So it brakes as late as it can: robots that have agreed on how
    to pass one another look like a danger long before they would have to brake.

    Attributes:
        interventions: how often braking has begun so far.
    """

    def __init__(self, scene: Scene, robot: str) -> None:
        self._scene = scene
        self._robot = robot
        self._braking = False
        self.interventions = 0

    def must_brake(self, memory: Memory, plan: Plan, first: Input, previous: Input) -> bool:
        """Whether to brake now instead of driving the plan's first input; counts when that begins.

        Args:
            memory: present states of everybody.
            plan: what the robot means to drive.
            first: the input that would be driven at this step.
            previous: the input of the step before.
        """
        must = self._is_danger(memory, plan, first, previous)
        self.interventions += must and not self._braking
        self._braking = must
        return must

    def _is_danger(self, memory: Memory, plan: Plan, first: Input, previous: Input) -> bool:
        others = [robot for robot in memory.robots if robot != self._robot]
        if not others:
            return False
        step_s, limits = self._scene.step_s, self._scene.robot(self._robot).limits
        state = memory.state(self._robot)
        at_once = braking_path(state, previous, limits, step_s)
        steps = min(len(at_once) + 1, len(plan.states))
        least_m = np.array([self._scene.collision_distance_m(self._robot, other) for other in others])
        ways = self._ways(memory, others, steps)
        planned = gaps_m(plan.states[:steps, :2], ways, least_m)
        if planned.min() >= 0.0:
            return False
        after_one = rollout(state, np.array([first]), step_s)[-1]
        later = np.concatenate([state[None], braking_path(after_one, first, limits, step_s)])
        stopping = gaps_m(at_once[:, :2], ways, least_m)
        too_late = gaps_m(later[:, :2], ways, least_m) < 0.0
        return bool(((planned < 0.0) & too_late & (stopping > planned)).any())

    def _ways(self, memory: Memory, others: list[str], steps: int) -> Array:
        """Positions of the others if they go on, and if they brake, shape (2, others, steps, 2)."""
        states = np.array([memory.state(other) for other in others])
        turns = np.array([memory.previous_input(other).turn_rate_radps for other in others])
        slowing = np.array([self._scene.robot(other).limits.acceleration_mps2 for other in others])
        return np.stack(
            [
                positions_ahead(states, turns, np.zeros(len(others)), steps, self._scene.step_s),
                positions_ahead(states, turns, slowing, steps, self._scene.step_s),
            ]
        )


def braking_path(state: Array, previous: Input, limits: Limits, step_s: float) -> Array:
    """States (n, 4), from the present one to the standstill that braking leads to."""
    states, speed = [], float(state[3])
    for _ in range(math.ceil(LONGEST_S / step_s)):
        previous = braking_input(limits, previous, speed, step_s)
        states.append(previous)
        speed += step_s * previous.acceleration_mps2
        if abs(speed) < 1e-9 and abs(previous.acceleration_mps2) < 1e-9:
            break
    return rollout(state, np.array(states), step_s)


def positions_ahead(
    states: Array, turn_rates_radps: Array, slowing_mps2: Array, steps: int, step_s: float
) -> Array:
    """Where vehicles will be that keep turning as they do and lose speed evenly until they stand.

    Args:
        states: present ones, shape (n, 4).
        turn_rates_radps: shape (n,).
        slowing_mps2: shape (n,); zero for a constant speed.
        steps: how many positions, the present one included.
        step_s: Δt in s.

    Returns:
        Shape (n, steps, 2).
    """
    times_s = step_s * np.arange(steps)
    headings = states[:, 2, None] + turn_rates_radps[:, None] * times_s
    speeds = np.maximum(np.abs(states[:, 3, None]) - slowing_mps2[:, None] * times_s, 0.0)
    signed = np.copysign(speeds, states[:, 3, None])[:, :-1, None] * step_s
    directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)[:, :-1]
    start = states[:, None, :2]
    return np.concatenate([start, start + np.cumsum(signed * directions, axis=1)], axis=1)


def gaps_m(path: Array, ways: Array, least_m: Array) -> Array:
    """Smallest distances between a path and the ways of others, less those that must be kept.

    Whoever has come to the end of its path or way stays there.

    Args:
        path: positions, shape (n, 2), the present one first.
        ways: positions of others, shape (h, m, steps, 2).
        least_m: the distances to keep, shape (m,).

    Returns:
        Shape (h, m).
    """
    steps = ways.shape[2]
    own = path[np.minimum(np.arange(steps), len(path) - 1)]
    gaps: Array = np.linalg.norm(ways - own, axis=-1).min(axis=-1) - least_m
    return gaps
