"""Where bus callbacks leave what arrives and the main thread takes it."""

import threading
from collections import deque
from collections.abc import Iterable
from itertools import chain
from typing import NamedTuple

PENDING_COMMANDS = 16
"""Commands kept per robot until they are taken, the newest ones: a flood costs bounded memory."""


class Arrivals(NamedTuple):
    """What has come since the last time."""

    commands: tuple[tuple[str, bytes], ...]
    """Payloads as received with the robot of the key, for each robot oldest first."""
    present: frozenset[str]
    """Whose liveliness token is there now, robots outside the scenario included."""
    gone: frozenset[str]
    """Whose token has gone since the last time, even if it is back."""
    interrupted: bool
    """Whether the run was asked to end; stays true."""


class Inbox:
    """Stores and wakes, and does nothing else, since a slow or failing callback stalls the whole session.

    Args:
        robots: ids of the scenario's robots.
    """

    def __init__(self, robots: Iterable[str]) -> None:
        self._changed = threading.Condition()
        self._news = False
        self._commands = {robot: _pending() for robot in robots}
        self._strangers = _pending()
        self._present: set[str] = set()
        self._gone: set[str] = set()
        self._interrupted = False

    def store_command(self, robot: str, payload: bytes) -> None:
        """A payload came on this robot's command key."""
        with self._changed:
            self._commands.get(robot, self._strangers).append((robot, payload))
            self._wake()

    def store_presence(self, robot: str, *, present: bool) -> None:
        """A robot's liveliness token appeared or went."""
        with self._changed:
            if present:
                self._present.add(robot)
            else:
                self._present.discard(robot)
                self._gone.add(robot)
            self._wake()

    def interrupt(self) -> None:
        """The run is to end."""
        with self._changed:
            self._interrupted = True
            self._wake()

    def take(self, timeout_s: float) -> Arrivals:
        """Wait for news and take them.

        Args:
            timeout_s: after which empty hands are returned; 0 or less does not wait. An interrupted inbox
                never waits.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._news or self._interrupted, timeout=max(timeout_s, 0.0))
            arrivals = Arrivals(
                tuple(chain(*self._commands.values(), self._strangers)),
                frozenset(self._present),
                frozenset(self._gone),
                self._interrupted,
            )
            for pending in (*self._commands.values(), self._strangers):
                pending.clear()
            self._gone.clear()
            self._news = False
        return arrivals

    def _wake(self) -> None:
        self._news = True
        self._changed.notify()


def _pending() -> deque[tuple[str, bytes]]:
    return deque(maxlen=PENDING_COMMANDS)
