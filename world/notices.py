"""What the log says of misbehaving robots, without a line for every step."""

import time
from collections import Counter
from collections.abc import Callable, Iterable

from structlog.typing import FilteringBoundLogger

MISSES_EVERY_S = 5.0


class Refusals:
    """Refused commands: each robot and reason is logged once, all are counted.

    Attributes:
        counts: refused commands by reason.
    """

    def __init__(self, log: FilteringBoundLogger) -> None:
        self._log = log
        self._told: set[tuple[str, str]] = set()
        self.counts: Counter[str] = Counter()

    def add(self, robot: str, reason: str, detail: str = "") -> None:
        """A command was refused.

        Args:
            robot: whose key it came on.
            reason: one of few, the same for all commands of this kind.
            detail: more about this command.
        """
        self.counts[reason] += 1
        if (robot, reason) not in self._told:
            self._told.add((robot, reason))
            self._log.warning("command refused", robot=robot, reason=reason, detail=detail)


class Misses:
    """Missed commands, summed up over a few seconds.

    Args:
        log: where the sums go.
        now_s: a monotonic clock.
    """

    def __init__(self, log: FilteringBoundLogger, now_s: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._now_s = now_s
        self._counts: Counter[str] = Counter()
        self._told_s: float | None = None

    def add(self, robots: Iterable[str]) -> None:
        """These robots had no command at a step; the first miss is told at once."""
        self._counts.update(robots)
        if self._told_s is None or self._now_s() - self._told_s >= MISSES_EVERY_S:
            self.tell()

    def tell(self) -> None:
        """Log what has not been told yet."""
        if self._counts:
            self._log.warning("commands missed", steps_by_robot=dict(self._counts))
            self._counts.clear()
            self._told_s = self._now_s()
