"""Ctrl-C, SIGTERM and a closed terminal as a wish to end in order, also while the solver is compiled."""

import signal
from types import FrameType
from typing import Self


class Interruption:
    """While entered, signals that would end the process are only noted, so that nothing is left half done.

    A signal that is ignored, as SIGHUP is under ``nohup``, stays ignored.

    Attributes:
        requested: a signal has come: end in order.
        insisted: another one has come: end without waiting for anything more.
    """

    SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def __init__(self) -> None:
        self.requested = False
        self.insisted = False

    def __enter__(self) -> Self:
        """Take over the signals."""
        taken = [number for number in self.SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
        self._former = {number: signal.signal(number, self._handle) for number in taken}
        return self

    def __exit__(self, *_error: object) -> None:
        """Give the signals back."""
        for number, handler in self._former.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.insisted = self.requested
        self.requested = True


def compile_solver(interruption: Interruption) -> None:
    """Wait until the solver is compiled, which takes no time where it has been.

    Raises:
        Refusal: it cannot be compiled or kept.
        KeyboardInterrupt: an interruption came before.
    """
    from agent.process.warm import compile_in_background  # which takes a second, and `keys` never needs

    if not compile_in_background(unwanted=lambda: interruption.requested):
        raise KeyboardInterrupt


def announced(begin: str) -> str:
    """What a command does first, with the wait for the solver if there is one."""
    from agent.solve.compiled import is_complete  # the same

    if is_complete():
        return begin
    return f"compiling the solver (once on this machine, about a minute), then {begin}"
