"""What the log says of a robot that is too slow, without a line for every step."""

import time
from collections.abc import Callable

from structlog.typing import FilteringBoundLogger

LATE_EVERY_S = 5.0


class LateDecisions:
    """Counts decisions that came too late; the first is told at once, then no more than one line in a while.

    Args:
        log: where the lines go.
        now_s: a monotonic clock.

    Attributes:
        count: so far.
    """

    def __init__(self, log: FilteringBoundLogger, now_s: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._now_s = now_s
        self._told_s: float | None = None
        self.count = 0

    def add(self, step: int) -> None:
        """The decision on the observation of this step came too late."""
        self.count += 1
        if self._told_s is None or self._now_s() - self._told_s >= LATE_EVERY_S:
            self._log.warning("decided too late", step=step, so_far=self.count)
            self._told_s = self._now_s()
