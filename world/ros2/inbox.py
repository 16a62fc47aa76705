"""Where odometry waits until the next step looks at it."""

import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

MOST_WAITING = 64
"""Of one robot. Of more than that in one step the oldest are not looked at."""


class Arrival(NamedTuple):
    """A payload as received."""

    robot: str
    payload: bytes
    arrived_s: float


class OdometryInbox:
    """Stores on any thread, and does nothing else; is emptied on one.

    Args:
        robots: ids.
        now_s: a monotonic clock.
    """

    def __init__(self, robots: Iterable[str], now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._waiting: dict[str, deque[Arrival]] = {robot: deque(maxlen=MOST_WAITING) for robot in robots}

    def store(self, robot: str, payload: bytes) -> None:
        """A payload has come on the odometry topic of one of the robots."""
        self._waiting[robot].append(Arrival(robot, payload, self._now_s()))

    def take(self) -> list[Arrival]:
        """What has come since the last time, of each robot in its order."""
        return [waiting.popleft() for waiting in self._waiting.values() for _ in range(len(waiting))]
