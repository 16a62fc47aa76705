"""Where bus callbacks leave what arrives and the main thread takes it."""

import threading
from collections.abc import Iterable
from typing import NamedTuple

COMMANDS_A_STEP = 16
"""How many a robot may give; one is wanted. Whoever says more waits for the next step, at its own expense."""


class Arrivals(NamedTuple):
    """What has come since the last time."""

    commands: tuple[tuple[str, bytes], ...]
    """Payloads as received with the robot of the key, for each robot oldest first."""
    present: frozenset[str]
    """Whose liveliness token is there now, robots outside the scenario included."""
    gone: frozenset[str]
    """Whose token has gone since the last time, even if it is back."""
    exhausted: frozenset[str]
    """Who has given all the commands that it may give at this step."""
    questions: tuple[tuple[str, bytes], ...]
    """By robot, with what it said last when it asked for the scene."""
    interrupted: bool
    """Whether the run was asked to end; stays true."""


class Inbox:
    """Stores and wakes, and does nothing else, since a failing callback stalls a whole session.

    A robot that has given ``COMMANDS_A_STEP`` is not listened to until the next step: its callback waits,
    then its connection, then the robot. So no command is lost uncounted, a flood costs bounded memory and
    time, and only the flooding robot waits.

    Args:
        robots: ids of the scenario's robots.
    """

    def __init__(self, robots: Iterable[str]) -> None:
        lock = threading.Lock()
        self._changed = threading.Condition(lock)
        self._listening_again = threading.Condition(lock)
        self._news = False
        self._commands: list[tuple[str, bytes]] = []
        self._given = dict.fromkeys(robots, 0)
        self._present: set[str] = set()
        self._gone: set[str] = set()
        self._questions: dict[str, bytes] = {}
        self._interrupted = False
        self._closed = False

    def store_command(self, robot: str, payload: bytes) -> None:
        """A payload came on the command key of one of the robots; waits while it has given too many."""
        with self._listening_again:
            self._listening_again.wait_for(lambda: self._closed or self._given[robot] < COMMANDS_A_STEP)
            if not self._closed:
                self._given[robot] += 1
                self._commands.append((robot, payload))
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

    def store_question(self, robot: str, payload: bytes) -> None:
        """One of the robots has asked for the scene."""
        with self._changed:
            self._questions[robot] = payload
            self._wake()

    def interrupt(self) -> None:
        """The run is to end."""
        with self._changed:
            self._interrupted = True
            self._wake()

    def begin_step(self) -> None:
        """Listen to every robot again."""
        with self._listening_again:
            self._given = dict.fromkeys(self._given, 0)
            self._listening_again.notify_all()

    def close(self) -> None:
        """No more commands are wanted; whoever waits to give one is released."""
        with self._listening_again:
            self._closed = True
            self._listening_again.notify_all()

    def take(self, timeout_s: float) -> Arrivals:
        """Wait for news and take them.

        Args:
            timeout_s: after which empty hands are returned; 0 or less does not wait. An interrupted inbox
                never waits.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._news or self._interrupted, timeout=max(timeout_s, 0.0))
            arrivals = Arrivals(
                tuple(self._commands),
                frozenset(self._present),
                frozenset(self._gone),
                frozenset(robot for robot, given in self._given.items() if given >= COMMANDS_A_STEP),
                tuple(self._questions.items()),
                self._interrupted,
            )
            self._commands.clear()
            self._questions.clear()
            self._gone.clear()
            self._news = False
        return arrivals

    def _wake(self) -> None:
        self._news = True
        self._changed.notify()
