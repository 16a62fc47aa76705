"""What ends a process: SIGINT and SIGTERM as a wish, and the end of the process that started it."""

import ctypes
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable

PARENT = "UNSPOKEN_PARENT"
"""Environment variable: the id of the process without which this one is not to live; unset: none."""

_PR_SET_PDEATHSIG = 1


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
