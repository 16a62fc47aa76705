"""Whose collision it was: who could still have braked.

A collision is *avoidable* for one of its robots if, at some step before it, the two would have met had both
gone on as they were (turning and driving with a constant rate and speed), and if braking from that step on,
as hard as its limits allow, would have kept the robot out of it, whatever the other one did. A robot
that braked in time, or that stood, is never blamed; nor is one to which the other gave no time.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agent.drive.reserve import braking_path
from agent.drive.safety import positions_ahead
from protocol.messages import TrueRobot, Truth
from protocol.scene import Scene
from protocol.vehicle import Input

AFTERWARDS_S = 1.0
"""For so long after the contact a robot that brakes must stay clear of the other one."""


class Avoidable(NamedTuple):
    """A collision that a robot could have avoided."""

    robot: str
    other: str
    step: int
    """Of the contact."""
    last_chance: int
    """The last step at which braking would have helped."""


def avoidable_collisions(truths: Sequence[Truth], scene: Scene, healthy: Collection[str]) -> list[Avoidable]:
    """The collisions of a run that one of its healthy robots could have avoided.

    Args:
        truths: of all steps, in their order.
        scene: of the run.
        healthy: robots that may be blamed.
    """
    by_step = {truth.step: truth.robots for truth in truths}
    contacts = {pair: truth.step for truth in reversed(truths) for pair in truth.collisions}
    found = []
    for pair, contact in sorted(contacts.items(), key=lambda each: each[1]):
        for robot, other in (pair, pair[::-1]):
            chance = _last_chance(by_step, scene, robot, other, contact) if robot in healthy else None
            if chance is not None:
                found.append(Avoidable(robot, other, contact, chance))
    return found


def _last_chance(
    by_step: Mapping[int, Mapping[str, TrueRobot]], scene: Scene, robot: str, other: str, contact: int
) -> int | None:
    """The last step at which both would have met as they went on, and braking would have prevented it."""
    least_m, limits = scene.collision_distance_m(robot, other), scene.robot(robot).limits
    for step in range(contact - 1, -1, -1):
        there = by_step.get(step, {})
        if robot not in there or other not in there:
            return None
        pair = there[robot], there[other]
        states = np.array([each.state.as_tuple() for each in pair])
        turns = np.array([each.turn_rate_radps for each in pair])
        applied = Input(pair[0].turn_rate_radps, pair[0].acceleration_mps2)
        braking = braking_path(states[0], applied, limits, scene.step_s)
        one, two = positions_ahead(states, turns, np.zeros(2), len(braking) + 1, scene.step_s)
        if np.linalg.norm(one - two, axis=-1).min() >= least_m:
            continue
        until = max(contact, step + len(braking) - 1) + round(AFTERWARDS_S / scene.step_s)
        for later in range(step + 1, until + 1):
            met = by_step.get(later, {}).get(other)
            if met is None:  # it drives as it did, and is gone before they meet
                return step
            own = braking[min(later - step, len(braking) - 1)]
            if np.hypot(own[0] - met.state.x_m, own[1] - met.state.y_m) < least_m:
                break
        else:
            return step
    return None
