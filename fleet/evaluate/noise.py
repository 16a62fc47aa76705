"""Levels of sensing: what ``--noise`` takes, such as ``low``, ``dropout=0.3`` or ``low+delay_steps=2``."""

import math
from typing import Annotated, Any

from pydantic import AfterValidator, ValidationError

from protocol.scenario import Scenario, Sensing

AS_IN_THE_FILE = "none"
"""This level leaves a scenario's sensing as its file says."""


def _times(factor: float) -> dict[str, float]:
    return {
        "position_noise_m": 0.02 * factor,
        "heading_noise_rad": math.radians(2.0) * factor,
        "speed_noise_mps": 0.05 * factor,
    }


LEVELS = {"low": _times(1.0), "medium": _times(2.0), "high": _times(4.0)}
"""Fields of sensing, by the names of levels of noise."""
GRAMMAR = (
    f"levels with commas between, each {AS_IN_THE_FILE} or made of {', '.join(LEVELS)} and FIELD=VALUE "
    "with + between, such as low+dropout=0.3"
)


class LevelError(ValueError):
    """A level that cannot be understood; the text says why and what is expected."""


def sensing_of(level: str) -> Sensing:
    """What a level other than ``none`` says of every robot's sensing; what it does not say is perfect.

    Raises:
        LevelError: a part of it is neither a name nor a field of sensing with a value in its range, or says
            again what another part says.
    """
    settings: dict[str, Any] = {}
    for part in level.split("+"):
        name, equals, value = part.partition("=")
        fields = {name: _number(name, value)} if equals else LEVELS.get(name)
        if fields is None:
            raise LevelError(f"{part!r} found, one of {', '.join(LEVELS)} or FIELD=VALUE is expected")
        if again := settings.keys() & fields.keys():
            raise LevelError(f"{level!r} says {min(again)} twice")
        settings |= fields
    try:
        return Sensing.model_validate(settings)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        raise LevelError(f"{level!r}: {first['loc'][0]}: {first['msg']}, found {first['input']!r}") from None


def _number(name: str, text: str) -> float | int:
    if name not in Sensing.model_fields:
        raise LevelError(f"{name!r} found, one of {', '.join(Sensing.model_fields)} is expected before =")
    try:
        return int(text) if text.isdecimal() else float(text)
    except ValueError:
        raise LevelError(f"{name}={text} found, a number is expected after =") from None


def _checked(level: str) -> str:
    if level != AS_IN_THE_FILE:
        sensing_of(level)
    return level


NoiseLevel = Annotated[str, AfterValidator(_checked)]
"""One level as ``--noise`` takes it, and as it stands in ``runs.csv``."""


def levels_in(text: str) -> tuple[str, ...]:
    """The levels of a list with commas, each once.

    Raises:
        LevelError: one of them cannot be understood.
    """
    return tuple(dict.fromkeys(_checked(part.strip()) for part in text.split(",")))


def with_noise(scenario: Scenario, level: str) -> Scenario:
    """The scenario with this level of sensing for every robot.

    Raises:
        LevelError: the level cannot be understood.
    """
    if level == AS_IN_THE_FILE:
        return scenario
    robots = [robot.model_copy(update={"sensing": None}) for robot in scenario.robots]
    return scenario.model_copy(update={"sensing": sensing_of(level), "robots": robots})


def needs_seeds(scenario: Scenario) -> bool:
    """Whether anything is drawn at random, so that runs with different seeds differ."""
    return any(_is_random(scenario.sensing_of(robot)) for robot in scenario.robots)


def _is_random(sensing: Sensing) -> bool:
    noises = sensing.position_noise_m, sensing.heading_noise_rad, sensing.speed_noise_mps
    return any(noises) or sensing.dropout > 0.0
