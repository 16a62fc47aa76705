"""Says what the bench is doing, and lets it be ended between two pieces of work."""

from collections.abc import Callable

from fleet.interruption import Interruption


class Watch:
    """What every section tells how it is getting on.

    Args:
        interruption: the wish to end.
        show: shows a line to whoever waits.
    """

    def __init__(self, interruption: Interruption, show: Callable[[str], None] = lambda _: None) -> None:
        self.interruption = interruption
        self._show = show

    def tell(self, what: str) -> None:
        """The next piece of work begins.

        Raises:
            KeyboardInterrupt: it is not to begin.
        """
        if self.interruption.requested:
            raise KeyboardInterrupt
        self._show(what)
