"""How a process of ours begins and ends: where its log lines go, and what ends it."""

import ctypes
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Mapping

import structlog
from structlog.typing import EventDict, WrappedLogger

PARENT = "UNSPOKEN_PARENT"
"""Environment variable: the id of the process without which this one is not to live; unset: none."""

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
    if not is_journal(_STDERR):
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


def is_journal(descriptor: int, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether a stream of this process goes to the journal, as ``JOURNAL_STREAM`` says of it."""
    told = environment.get("JOURNAL_STREAM")
    if told is None:
        return False
    stream = os.fstat(descriptor)
    return told == f"{stream.st_dev}:{stream.st_ino}"


def _with_priority(_logger: WrappedLogger, name: str, line: EventDict | str) -> str:
    return f"<{_PRIORITIES.get(name, _PRIORITIES['info'])}>{line}"
