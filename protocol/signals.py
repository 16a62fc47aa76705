"""SIGINT and SIGTERM as a wish to end, for processes that wait on queues and conditions."""

import signal
import socket
import threading
from collections.abc import Callable


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
