"""What faults make of the input that a robot commands."""

from collections.abc import Callable
from typing import Any

from fleet.inject.schedule import Scheduled
from protocol.faults import CommandExcess, Weak
from protocol.messages import Command
from protocol.vehicle import Input, Limits

LARGEST = 1e6
"""Of an input that can be told."""

Drives = Callable[[Any, Limits, Input], Input]


def _excess(fault: CommandExcess, _limits: Limits, wanted: Input) -> Input:
    return Input(*(_clipped(fault.factor * each, LARGEST) for each in wanted))


def _weak(fault: Weak, limits: Limits, wanted: Input) -> Input:
    strongest = fault.factor * limits.acceleration_mps2
    return wanted._replace(acceleration_mps2=_clipped(wanted.acceleration_mps2, strongest))


DRIVEN_OTHERWISE: dict[type[Any], Drives] = {CommandExcess: _excess, Weak: _weak}
"""What each kind makes of an input, given the limits of the vehicle."""


def driven_otherwise(scheduled: Scheduled[Any], command: Command, limits: Limits) -> Command:
    """A command as a fault changes it: the input of its step, and that of the step after."""
    change = DRIVEN_OTHERWISE[type(scheduled.fault)]
    turn_rate, acceleration = change(scheduled.fault, limits, command.input)
    then = command.then and tuple(change(scheduled.fault, limits, Input(*command.then)))
    return command.model_copy(
        update={"turn_rate_radps": turn_rate, "acceleration_mps2": acceleration, "then": then}
    )


def _clipped(value: float, largest: float) -> float:
    return min(max(value, -largest), largest)
