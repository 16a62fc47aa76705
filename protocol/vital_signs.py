"""Whether a process goes on, and does what it is there for: for people, health checks and systemd."""

import time
from collections.abc import Callable

from protocol.service_manager import LONGEST_START_S, ServiceManager

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
