"""Whether a process goes on, and does what it is there for: for people, health checks and systemd."""

import time
from bisect import bisect_left
from collections.abc import Callable, Sequence

from chassis.service_manager import LONGEST_START_S, ServiceManager

BOUNDS_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""From a fast phase to a decision by the reference solver."""


class Durations:
    """Counts durations; added to on one thread, looked at on any.

    Args:
        bounds_s: upper ends of the classes in s; one more, without end, comes after them.
    """

    def __init__(self, bounds_s: Sequence[float] = BOUNDS_S) -> None:
        self._bounds_s = bounds_s
        self._counts = [0] * (len(bounds_s) + 1)
        self.sum_s = 0.0

    def add(self, duration_s: float) -> None:
        """Something took so long."""
        self._counts[bisect_left(self._bounds_s, duration_s)] += 1
        self.sum_s += duration_s

    def buckets(self) -> list[tuple[str, float]]:
        """As Prometheus wants them: each bound, and how many took no longer."""
        names = [*map(str, self._bounds_s), "+Inf"]
        counts = list(self._counts)
        return [(name, float(sum(counts[: index + 1]))) for index, name in enumerate(names)]


BEAT_S = 0.5
"""No loop waits longer without a sign of life."""
LONGEST_SILENCE_S = 10.0
"""A loop that has given no sign of life for longer hangs."""


class VitalSigns:
    """The loop of a process gives its signs of life here; any thread may ask how it is.

    Args:
        manager: gets the signs of life, too; None for the one that this process was started by.
        now_s: a monotonic clock.
    """

    def __init__(
        self, manager: ServiceManager | None = None, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self.now_s = now_s
        self._manager = manager or ServiceManager.of_environment()
        self._beaten_s: float | None = None
        self._longest_s = LONGEST_START_S
        self._wanting: str | None = "it has just been started"

    def beat(self) -> None:
        """The loop goes on; called by the loop itself, at least every ``BEAT_S`` while it waits."""
        self._beaten_s = self.now_s()
        self._manager.alive()

    def wants(self, what: str) -> None:
        """The process cannot do yet, or not any more, what it is there for; why, for people."""
        if what != self._wanting:
            self._wanting = what
            self._manager.tell(STATUS=what)

    def works(self, how: str) -> None:
        """The process does what it is there for; how, for people."""
        self._wanting = None
        self._manager.tell(STATUS=how)

    def up(self) -> None:
        """The start is over: whoever waits for this process need not wait any more."""
        self._longest_s = LONGEST_SILENCE_S
        self._manager.up()

    def ends(self) -> None:
        """The process is about to end in order."""
        self.wants("it ends")
        self._manager.tell(STOPPING="1")

    def why_not_live(self) -> str | None:
        """What speaks against the loop going on; None: nothing."""
        if self._beaten_s is None:
            return self._wanting
        silent_s = self.now_s() - self._beaten_s
        if silent_s <= self._longest_s:
            return None
        return f"no sign of life for {silent_s:.0f} s"

    def why_not_ready(self) -> str | None:
        """What keeps the process from what it is there for; None: nothing."""
        return self.why_not_live() or self._wanting
