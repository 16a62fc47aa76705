"""Whose collision it was: who could still have braked.

A collision is *avoidable* for one of its robots if, at some step before it, the two would have met had both
gone on as they were (turning and driving with a constant rate and speed), and if braking from that step on,
as hard as its limits allow, would have kept the robot out of it, whatever the other one did. A robot
that braked in time, or that stood, is never blamed; nor is one to which the other gave no time.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agent.drive.safety import braking_path, positions_ahead
from agent.solve.vehicle import Array
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
    found = []
    for pair, contact in _contacts(truths).items():
        for robot, other in (pair, pair[::-1]):
            if robot in healthy:
                chance = _last_chance(by_step, scene, robot, other, contact)
                if chance is not None:
                    found.append(Avoidable(robot, other, contact, chance))
    return found


def _contacts(truths: Sequence[Truth]) -> dict[tuple[str, str], int]:
    """The step of each collision by its pair."""
    contacts: dict[tuple[str, str], int] = {}
    for truth in truths:
        for pair in truth.collisions:
            contacts.setdefault(pair, truth.step)
    return contacts


def _last_chance(
    by_step: Mapping[int, Mapping[str, TrueRobot]], scene: Scene, robot: str, other: str, contact: int
) -> int | None:
    for step in range(contact - 1, -1, -1):
        robots = by_step.get(step, {})
        if robot not in robots or other not in robots:
            return None
        braking = _braking(robots[robot], scene, robot)
        if not _in_sight(robots[robot], robots[other], scene, (robot, other), len(braking) + 1):
            continue
        if _stays_clear(braking, by_step, scene, (robot, other), step, contact):
            return step
    return None


def _braking(robot: TrueRobot, scene: Scene, name: str) -> Array:
    applied = Input(robot.turn_rate_radps, robot.acceleration_mps2)
    return braking_path(_state(robot), applied, scene.robot(name).limits, scene.step_s)


def _in_sight(robot: TrueRobot, other: TrueRobot, scene: Scene, names: tuple[str, str], steps: int) -> bool:
    """Whether both would meet within some steps if they went on as they are."""
    states = np.array([_state(robot), _state(other)])
    turns = np.array([robot.turn_rate_radps, other.turn_rate_radps])
    one, two = positions_ahead(states, turns, np.zeros(2), steps, scene.step_s)
    return bool(np.linalg.norm(one - two, axis=-1).min() < scene.collision_distance_m(*names))


def _stays_clear(
    braking: Array,
    by_step: Mapping[int, Mapping[str, TrueRobot]],
    scene: Scene,
    names: tuple[str, str],
    step: int,
    contact: int,
) -> bool:
    """Whether a robot that brakes from a step on is not met by the other, which drives as it did."""
    until = max(contact, step + len(braking) - 1) + round(AFTERWARDS_S / scene.step_s)
    for later in range(step + 1, until + 1):
        there = by_step.get(later, {}).get(names[1])
        if there is None:
            return True
        own = braking[min(later - step, len(braking) - 1)]
        if np.hypot(own[0] - there.state.x_m, own[1] - there.state.y_m) < scene.collision_distance_m(*names):
            return False
    return True


def _state(robot: TrueRobot) -> Array:
    return np.array(robot.state.as_tuple())
