"""When each fault of a run strikes whom: decided by the run's seed and nothing else."""

import math
import zlib
from collections.abc import Sequence
from typing import Generic, TypeVar

import numpy as np

from protocol.faults import Fault

F = TypeVar("F", bound=Fault, covariant=True)


class Scheduled(Generic[F]):
    """One fault of a run, with its times in steps.

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
        start_s = fault.start_s
        if isinstance(start_s, tuple):
            begin_s, end_s = start_s
            start_s = begin_s + (end_s - begin_s) * self.draw("", 0)
        self.begin = _step_at(start_s, step_s)
        self.end = (
            None
            if fault.duration_s is None
            else max(_step_at(start_s + fault.duration_s, step_s), self.begin + 1)
        )

    def is_on(self, step: int) -> bool:
        """Whether a step lies within the fault's time."""
        return self.begin <= step and (self.end is None or step < self.end)

    def befalls(self, robot: str) -> bool:
        """Whether the fault is one of this robot."""
        robots = getattr(self.fault, "robots", None)
        return robots is None or robot in robots

    def strikes(self, robot: str, step: int) -> bool:
        """Whether a robot has the fault at a step; where it has a rate, as the lot of that step falls."""
        rate = getattr(self.fault, "rate", 1.0)
        return self.befalls(robot) and self.is_on(step) and (rate >= 1.0 or self.draw(robot, step) < rate)

    def draw(self, robot: str, step: int) -> float:
        """A number in [0, 1): the lot of a robot at a step, always the same."""
        return float(self.random(robot, step).random())

    def random(self, robot: str, step: int) -> np.random.Generator:
        """Whatever else is random about the fault for a robot at a step."""
        return np.random.default_rng((*self._origin, zlib.crc32(robot.encode()), step))


def schedule(faults: Sequence[Fault], *, seed: int, step_s: float) -> list[Scheduled[Fault]]:
    """All faults of a run with their times."""
    return [Scheduled(fault, index, seed=seed, step_s=step_s) for index, fault in enumerate(faults)]


def _step_at(time_s: float, step_s: float) -> int:
    """The first step at or after a time; a quotient that is whole up to rounding is taken as whole."""
    return math.ceil(time_s / step_s - 1e-9)
