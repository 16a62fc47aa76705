"""Kinds of faults between one robot and the world: what it commands, and what becomes of that on its way."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from fleet.inject.fault import Ids, RobotFault, Share, Steps
from protocol.vehicle import Input, Limits

LARGEST = 1e6
"""Of an input that can be told."""


class InputFault(RobotFault):
    """Another input is driven than the one commanded."""

    def driven(self, wanted: Input, limits: Limits) -> Input:
        """That input, given the limits of the vehicle."""
        raise NotImplementedError


class CommandExcess(InputFault):
    """A share of the commands is multiplied by a factor, beyond what the vehicle can do."""

    kind: Literal["command-excess"]
    factor: Annotated[float, Field(gt=0, le=1e4)] = 10.0
    rate: Share = 1.0

    def driven(self, wanted: Input, _limits: Limits) -> Input:
        return Input(*(_clipped(self.factor * each, LARGEST) for each in wanted))


class Weak(InputFault):
    """The robot accelerates and brakes with only a part of what its limits promise."""

    kind: Literal["weak"]
    robots: Ids
    factor: Share = 0.5

    def driven(self, wanted: Input, limits: Limits) -> Input:
        strongest = self.factor * limits.acceleration_mps2
        return wanted._replace(acceleration_mps2=_clipped(wanted.acceleration_mps2, strongest))


def _clipped(value: float, largest: float) -> float:
    return min(max(value, -largest), largest)


class CommandDeliveryFault(RobotFault):
    """Commands do not come once and in time."""

    copies: ClassVar[int] = 1
    """How many come."""

    def late_steps(self) -> int:
        return 0


class CommandLoss(CommandDeliveryFault):
    """A share of the commands is lost."""

    kind: Literal["command-loss"]
    rate: Share
    copies = 0


class CommandDelay(CommandDeliveryFault):
    """A share of the commands comes so many steps late."""

    kind: Literal["command-delay"]
    steps: Steps
    rate: Share = 1.0

    def late_steps(self) -> int:
        return self.steps


class CommandDuplication(CommandDeliveryFault):
    """A share of the commands comes twice."""

    kind: Literal["command-duplication"]
    rate: Share
    copies = 2
