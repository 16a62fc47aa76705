"""Shows a run to a person or a program, once or until it ends."""

import time
from collections.abc import Callable
from typing import Final

from rich.console import Console
from rich.live import Live

from fleet.interruption import Interruption
from fleet.status.showing import shown
from fleet.status.standing import Status
from fleet.status.watching import Listener

REFRESH_S: Final = 0.5
ONCE_S: Final = 2.0
"""How long is listened before a single look: times and rates are of what came."""
LAST_WORDS_S: Final = 1.0
"""How long the verdict of a run may take that has ended by what else is known."""


class Follower:
    """Looks at a run again and again.

    Args:
        listener: to it.
        interruption: the wish to leave.
        goes_on: whether, as far as is known otherwise, the run goes on; asked at every look.
    """

    def __init__(
        self, listener: Listener, interruption: Interruption, goes_on: Callable[[Status], bool]
    ) -> None:
        self._listener = listener
        self._interruption = interruption
        self._goes_on = goes_on

    def once(self) -> Status:
        """One look, after some listening."""
        until_s = time.monotonic() + ONCE_S
        while time.monotonic() < until_s and not self._is_over():
            self._listener.listen(min(until_s, time.monotonic() + REFRESH_S))
        return self._status()

    def follow(self, show: Callable[[Status], None]) -> bool:
        """Show the run until its verdict, or until that is not wanted any more.

        Returns:
            False where the run has ended without a verdict.
        """
        while True:
            self._listener.listen(time.monotonic() + REFRESH_S)
            status = self._status()
            if not self._goes_on(status):
                self._listener.listen(time.monotonic() + LAST_WORDS_S)
                show(self._status())
                return self._is_over()
            show(status)
            if self._is_over():
                return True

    def _is_over(self) -> bool:
        return self._interruption.requested or self._listener.standing.verdict is not None

    def _status(self) -> Status:
        return self._listener.standing.status(time.monotonic())


def follow_live(follower: Follower, console: Console) -> bool:
    """Follow on a terminal; see :meth:`Follower.follow`."""
    with Live(console=console, auto_refresh=False) as live:
        return follower.follow(
            lambda status: live.update(shown(status, console.width, console.height), refresh=True)
        )
