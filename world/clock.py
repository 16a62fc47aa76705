"""The two clocks of a run: until when the commands of a step are awaited."""

import time
from collections.abc import Callable
from enum import StrEnum

LATENESS = 0.1
"""Part of Δt by which a real-time step may be late without moving the schedule."""


class ClockKind(StrEnum):
    """The choice of a clock."""

    LOCKSTEP = "lockstep"
    REALTIME = "realtime"


class LockStep:
    """A step ends when every present robot has answered it, or after a limit that only a hung robot meets."""

    waits_for_all = True
    overruns = 0

    def __init__(self, answer_timeout_s: float, now_s: Callable[[], float] = time.monotonic) -> None:
        self._answer_timeout_s = answer_timeout_s
        self._now_s = now_s
        self._until_s = now_s()

    def begin_step(self) -> None:
        """Start the time limit anew."""
        self._until_s = self._now_s() + self._answer_timeout_s

    def remaining_s(self) -> float:
        """Time left until the limit."""
        return self._until_s - self._now_s()


class RealTime:
    """Step k is published at start + k·Δt, whoever has answered.

    When the world itself is late by more than a tenth of Δt, the start is moved by the lateness: the steps
    after it keep their distance of Δt instead of following in a burst which no robot could answer. Smaller
    delays do not add up.
    """

    waits_for_all = False

    def __init__(self, step_s: float, now_s: Callable[[], float] = time.monotonic) -> None:
        self._step_s = step_s
        self._now_s = now_s
        self._begun = 0
        self._start_s = 0.0
        self.overruns = 0

    def begin_step(self) -> None:
        """Note that a step begins; the first one starts the schedule."""
        now_s = self._now_s()
        if self._begun == 0:
            self._start_s = now_s
        lateness_s = now_s - self._next_s()
        if lateness_s > LATENESS * self._step_s:
            self._start_s += lateness_s
            self.overruns += 1
        self._begun += 1

    def remaining_s(self) -> float:
        """Time left until the next step is due."""
        return self._next_s() - self._now_s()

    def _next_s(self) -> float:
        return self._start_s + self._begun * self._step_s


Clock = LockStep | RealTime
