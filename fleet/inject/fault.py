"""What a fault is, and when it strikes whom: decided by the seed of the run and nothing else.

A kind of fault is one class: its fields, as a scenario or a file of faults lists them, and what it does. To
add one, derive it from the group of what it acts on (in ``link``, ``mind`` or ``process_faults``). A list of
faults means the same for real processes and in virtual time.
"""

import math
import zlib
from collections.abc import Iterable, Sequence
from copy import copy
from typing import Annotated, Any, ClassVar, Generic, NamedTuple, Self, TypeVar, get_args

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, field_validator

from chassis.files import Record
from protocol.keys import Id
from protocol.scenario import Interval, Time, as_tuple

MAX_LATE_STEPS = 10

Share = Annotated[float, Field(gt=0, le=1)]
"""A probability at each step."""
Steps = Annotated[int, Field(ge=1, le=MAX_LATE_STEPS)]
Ids = Annotated[tuple[Id, ...], BeforeValidator(as_tuple), Field(min_length=1, max_length=128)]


def _time_or_interval(value: object) -> str:
    return "interval" if isinstance(value, list | tuple) else "time"


KINDS: "dict[str, type[Fault]]" = {}
"""Every kind by its name; filled where the kinds are defined."""


class Fault(Record):
    """Something that is to break, in simulated seconds since step 0."""

    kind: str
    start_s: Annotated[
        Annotated[Time, Tag("time")] | Annotated[Interval, Tag("interval")], Discriminator(_time_or_interval)
    ] = 0.0
    """A pair stands for a time drawn from between both."""
    duration_s: Annotated[float, Field(gt=0, le=1e5)] | None = None
    """None: to the end of the run."""

    needs_processes: ClassVar[bool] = False
    """Whether it means nothing in virtual time."""
    exit_status: ClassVar[int | None] = None
    """With which a run ends whose recording it cuts short; None: it does not."""

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Register a kind; a group of kinds has no name."""
        for name in get_args(cls.model_fields["kind"].annotation):
            KINDS[name] = cls

    @field_validator("start_s")
    @classmethod
    def _interval_is_in_order(cls, start_s: float | tuple[float, float]) -> float | tuple[float, float]:
        if isinstance(start_s, tuple) and start_s[0] > start_s[1]:
            raise ValueError("the first time of the interval must not be after the second")
        return start_s

    def befalls(self, _robot: str) -> bool:
        """Whether it is one of this robot; one of the world, the machine or the recording is nobody's."""
        return False


class RobotFault(Fault):
    """Befalls robots, each by draws of its own."""

    robots: Ids | None = None
    """None: every robot."""

    def befalls(self, robot: str) -> bool:
        """See :class:`Fault`."""
        return self.robots is None or robot in self.robots


class NamedRobotFault(RobotFault):
    """Would leave no healthy robot if it befell everybody unasked."""

    robots: Ids


F = TypeVar("F", bound=Fault, covariant=True)


class Strike(NamedTuple):
    """A fault strikes a robot at a step."""

    robot: str
    begin: int
    """The first step of the fault."""
    random: np.random.Generator
    """For what is random about how the fault strikes; independent of whether it does."""


class Scheduled(Generic[F]):
    """A fault of a run, with its times in steps.

    Args:
        fault: as written.
        index: its place in the list, which with the seed fixes everything random about it.
        seed: of the run.
        step_s: Δt in s.

    Attributes:
        begin: the first step at which it strikes.
        end: the first step at which it does not any more; None: it lasts to the end.
    """

    def __init__(self, fault: F, index: int, *, seed: int, step_s: float) -> None:
        self.fault = fault
        self._origin = (seed, index)
        start_s, duration_s = fault.start_s, fault.duration_s
        if isinstance(start_s, tuple):
            start_s = start_s[0] + (start_s[1] - start_s[0]) * float(self._random("", 0).random())
        self.begin = _step_at(start_s, step_s)
        self.end = None if duration_s is None else max(_step_at(start_s + duration_s, step_s), self.begin + 1)

    def anew(self) -> Self:
        """The same fault, which has kept nothing yet from step to step."""
        fresh = copy(self)
        fresh.fault = self.fault.model_copy()
        return fresh

    def is_on(self, step: int) -> bool:
        """Whether a step lies within the fault's time."""
        return self.begin <= step and (self.end is None or step < self.end)

    def strike(self, robot: str, step: int) -> Strike | None:
        """How it strikes a robot at a step; None if it does not: with a rate, a lot is drawn at each step."""
        if not (self.fault.befalls(robot) and self.is_on(step)):
            return None
        random = self._random(robot, step)
        is_struck = random.random() < getattr(self.fault, "rate", 1.0)
        return Strike(robot, self.begin, random) if is_struck else None

    def _random(self, robot: str, step: int) -> np.random.Generator:
        return np.random.default_rng((*self._origin, zlib.crc32(robot.encode()), step))


def schedule(faults: Sequence[Fault], *, seed: int, step_s: float) -> list[Scheduled[Fault]]:
    """All faults of a run with their times."""
    return [Scheduled(fault, index, seed=seed, step_s=step_s) for index, fault in enumerate(faults)]


def of_kind(
    faults: Iterable[Scheduled[Any]], group: type[F] | tuple[type[F], ...], robot: str | None = None
) -> list[Scheduled[F]]:
    """The faults of a kind, of a group of kinds, or of several groups; of one robot only, if one is named."""
    found = (each for each in faults if isinstance(each.fault, group))
    return [each for each in found if robot is None or each.fault.befalls(robot)]


def _step_at(time_s: float, step_s: float) -> int:
    """The first step at or after a time; a quotient that is whole up to rounding is taken as whole."""
    return math.ceil(time_s / step_s - 1e-9)
