"""How a process of ours begins and ends: its log lines, what ends it, and what the service manager is told.

The service manager is told by systemd's protocol (``sd_notify``); where none listens, in ``NOTIFY_SOCKET``,
nothing is sent.
"""

import ctypes
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping

from structlog.typing import EventDict, WrappedLogger

from chassis.lean import structlog

PARENT = "UNSPOKEN_PARENT"
"""Environment variable: the id of the process without which this one is not to live; unset: none."""

LONGEST_START_S = 120.0
"""What a process may take for one piece of its start, such as loading the solver on a slow device."""
FEEDINGS = 4
"""A watchdog is fed so many times in the time in which it wants to be fed once."""
BEAT_S = 0.5
"""No loop waits longer without a sign of life."""

_US = 1e6
_PRIORITIES: Mapping[str, int] = {"debug": 7, "info": 6, "warning": 4, "error": 3, "critical": 2}
"""Of the journal, by the level of a line."""
_PR_SET_PDEATHSIG = 1
_STDERR = 2


def on_wish_to_end(end: Callable[[], object]) -> None:
    """From now on call this for each SIGINT or SIGTERM, on a thread of its own; to be called once.

    A Python handler would not do: it runs when the main thread leaves its wait, and a signal that comes just
    before a wait begins does not end it. The interpreter writes to the wake-up socket at once.
    """
    hears, tells = socket.socketpair()
    tells.setblocking(False)

    def watch() -> None:
        with hears, tells:
            while hears.recv(1):
                end()

    threading.Thread(target=watch, daemon=True).start()
    signal.set_wakeup_fd(tells.fileno())
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: None)


def end_with_parent() -> None:
    """Be killed as soon as the process that ``PARENT`` names has ended, however that ends.

    The kernel sees to it, so that it holds for a process that is stopped or hangs, too; only Linux does. It
    counts as the end of the parent when that thread of it ends which has started this process. Where
    ``PARENT`` is not set, or on another system, this does nothing.
    """
    parent = os.environ.get(PARENT)
    if parent is None or sys.platform != "linux":
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(parent):  # it has ended before the kernel knew of the wish
        os.kill(os.getpid(), signal.SIGKILL)


def log_to_journal() -> None:
    """Under systemd's journal, write a line as ``<4>event="…" key=value …``, which keeps its priority.

    Whatever a value holds, it stays one line. Elsewhere lines stay as they are, for a terminal.
    """
    if not _is_journal(_STDERR):
        return
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.format_exc_info,
            structlog.processors.LogfmtRenderer(key_order=["event"]),
            _with_priority,
        ],
        logger_factory=structlog.WriteLoggerFactory(sys.stderr),
        cache_logger_on_first_use=False,
    )


def _is_journal(descriptor: int) -> bool:
    """Whether a stream of this process goes to the journal, as ``JOURNAL_STREAM`` says of it."""
    told = os.environ.get("JOURNAL_STREAM")
    if told is None:
        return False
    stream = os.fstat(descriptor)
    return told == f"{stream.st_dev}:{stream.st_ino}"


def _with_priority(_logger: WrappedLogger, name: str, line: EventDict | str) -> str:
    return f"<{_PRIORITIES.get(name, _PRIORITIES['info'])}>{line}"


class ServiceManager:
    """Sends datagrams that never wait: the loop that reports must not depend on who listens.

    What is not taken at once goes out with the next message; of each kind only the newest counts.

    Args:
        environment: names the socket, by a path or by ``@`` and an abstract name, and the time within which a
            sign of life is expected; only a watchdog that is meant for this process counts.
        now_s: a monotonic clock.
    """

    def __init__(
        self, environment: Mapping[str, str] = os.environ, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._log = structlog.get_logger("service")
        address = environment.get("NOTIFY_SOCKET")
        # An abstract name begins with a zero byte, which is written as @.
        self._address = f"\0{address[1:]}" if address and address.startswith("@") else address
        watchdog_us, own = environment.get("WATCHDOG_USEC", ""), str(os.getpid())
        meant = watchdog_us.isdigit() and environment.get("WATCHDOG_PID", own) == own
        self._watchdog_s = int(watchdog_us) / _US if meant else None
        self._pause_s = LONGEST_START_S / FEEDINGS
        self._now_s = now_s
        self._is_up = False
        self._fed_s: float | None = None
        self._unsaid: dict[str, str] = {}

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
