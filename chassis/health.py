"""How a process is, reported by its loop: to people, health checks and the service manager.

The service manager is told by systemd's protocol (``sd_notify``); where none listens, in ``NOTIFY_SOCKET``,
nothing is sent.
"""

import os
import socket
import time
from collections.abc import Callable, Mapping
from typing import Self

import structlog

LONGEST_START_S = 120.0
"""What a process may take for one piece of its start, such as loading the solver on a slow device."""
FEEDINGS = 4
"""A watchdog is fed so many times in the time in which it wants to be fed once."""
BEAT_S = 0.5
"""No loop waits longer without a sign of life."""
LONGEST_SILENCE_S = 10.0
"""A loop that has given no sign of life for longer hangs."""

_US = 1e6


class ServiceManager:
    """Sends datagrams that never wait: the loop that reports must not depend on who listens.

    What is not taken at once goes out with the next message; of each kind only the newest counts.

    Args:
        address: of the socket: a path, or ``@`` and an abstract name; None: nobody listens.
        watchdog_s: within which a sign of life is expected; None: never.
        now_s: a monotonic clock.
    """

    def __init__(
        self,
        address: str | None = None,
        watchdog_s: float | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._log = structlog.get_logger("service")
        # An abstract name begins with a zero byte, which is written as @.
        self._address = address and (f"\0{address[1:]}" if address.startswith("@") else address)
        self._pause_s = LONGEST_START_S / FEEDINGS
        self._watchdog_s = watchdog_s
        self._now_s = now_s
        self._is_up = False
        self._fed_s: float | None = None
        self._unsaid: dict[str, str] = {}

    @classmethod
    def of_environment(cls, environment: Mapping[str, str] = os.environ) -> Self:
        """The one that this process was started by; only a watchdog that is meant for this process counts."""
        watchdog_us = environment.get("WATCHDOG_USEC")
        meant = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        watchdog_s = int(watchdog_us) / _US if watchdog_us and watchdog_us.isdigit() and meant else None
        return cls(environment.get("NOTIFY_SOCKET"), watchdog_s)

    def alive(self) -> None:
        """The loop goes on: feeds the watchdog or, before :meth:`up`, asks for more time to start.

        To be called by the loop itself, as often as it likes.
        """
        now_s = self._now_s()
        if self._fed_s is not None and now_s - self._fed_s < self._pause_s and not self._unsaid:
            return
        if not self._is_up:
            self.tell(EXTEND_TIMEOUT_USEC=str(round(LONGEST_START_S * _US)))
        elif self._watchdog_s is not None or self._unsaid:
            self.tell(WATCHDOG="1")
        self._fed_s = now_s

    def up(self) -> None:
        """The process does from now on what it was started for."""
        if not self._is_up:
            self._is_up = True
            self._unsaid.pop("EXTEND_TIMEOUT_USEC", None)
            if self._watchdog_s is not None:
                self._pause_s = self._watchdog_s / FEEDINGS
            self.tell(READY="1")

    def tell(self, **words: str) -> None:
        """Tell by assignments such as ``STATUS="waiting"``."""
        if self._address is None:
            return
        self._unsaid |= words
        said = "\n".join(f"{name}={' '.join(value.split())}" for name, value in self._unsaid.items())
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sending:
                sending.sendto(said.encode(), self._address)
        except BlockingIOError:  # its queue is full
            return
        except OSError as error:
            self._log.warning("the service manager does not listen", reason=error.strerror)
            self._address = None
        self._unsaid.clear()


class VitalSigns:
    """The loop of a process gives its signs of life here; any thread may ask how it is.

    Args:
        now_s: a monotonic clock.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self.now_s = now_s
        self._manager = ServiceManager.of_environment()
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
        return f"no sign of life for {silent_s:.0f} s" if silent_s > self._longest_s else None

    def why_not_ready(self) -> str | None:
        """What keeps the process from what it is there for; None: nothing."""
        return self.why_not_live() or self._wanting
