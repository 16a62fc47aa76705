"""What the log says of misbehaving robots, without a line for every step."""

import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

from structlog.typing import FilteringBoundLogger

MISSES_EVERY_S = 5.0

R = TypeVar("R", bound=str)


class RefusalNotices(Generic[R]):
    """What is refused of robots: each robot and reason is logged once, all are counted.

    Args:
        log: for people.
        event: what a line in it begins with.
    """

    def __init__(self, log: FilteringBoundLogger, event: str) -> None:
        self._log = log
        self._event = event
        self._counts: dict[str, Counter[R]] = {}

    @property
    def counts(self) -> dict[str, dict[R, int]]:
        """How many were refused, by robot and reason."""
        return {robot: dict(reasons) for robot, reasons in self._counts.items()}

    def add(self, robot: str, reason: R, detail: str) -> None:
        """Something was refused.

        Args:
            robot: whose key it came on.
            reason: the same for all of this kind.
            detail: more about this one.
        """
        counts = self._counts.setdefault(robot, Counter())
        if reason not in counts:
            self._log.warning(self._event, robot=robot, reason=reason, detail=detail)
        counts[reason] += 1


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
