"""Levels of sensor noise by name."""

import math
from typing import Literal

from protocol.scenario import Scenario, Sensing

NoiseName = Literal["none", "low", "medium", "high"]
"""What ``--noise`` takes; ``none`` leaves a scenario's sensing as its file says."""


def _times(factor: float) -> Sensing:
    return Sensing(
        position_noise_m=0.02 * factor,
        heading_noise_rad=math.radians(2.0) * factor,
        speed_noise_mps=0.05 * factor,
    )


LEVELS: dict[NoiseName, Sensing] = {"low": _times(1.0), "medium": _times(2.0), "high": _times(4.0)}
"""What every robot senses, in place of all that the file says of sensing."""


def with_noise(scenario: Scenario, level: NoiseName) -> Scenario:
    """The scenario with this level of noise for every robot."""
    if level not in LEVELS:
        return scenario
    robots = [robot.model_copy(update={"sensing": None}) for robot in scenario.robots]
    return scenario.model_copy(update={"sensing": LEVELS[level], "robots": robots})


def needs_seeds(scenario: Scenario) -> bool:
    """Whether anything is drawn at random, so that runs with different seeds differ."""
    return any(_is_random(scenario.sensing_of(robot)) for robot in scenario.robots)


def _is_random(sensing: Sensing) -> bool:
    noises = sensing.position_noise_m, sensing.heading_noise_rad, sensing.speed_noise_mps
    return any(noises) or sensing.dropout > 0.0
