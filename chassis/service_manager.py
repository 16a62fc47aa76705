"""What a process tells the service manager that has started it, by systemd's protocol (``sd_notify``).

Without a service manager that listens, in ``NOTIFY_SOCKET``, nothing is told.
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

_US = 1e6


class ServiceManager:
    """Tells by datagrams that never wait: the loop that tells must not depend on who listens.

    What is not taken at once is told with the next word; of each kind only the newest counts.

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
        self._address = address and _as_bound(address)
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


def _as_bound(address: str) -> str:
    """As a socket is bound to it: an abstract name begins with a zero byte, written as ``@``."""
    return "\0" + address[1:] if address.startswith("@") else address
