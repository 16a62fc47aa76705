"""By when a decision should be made: what solvers ask before they go on improving."""

from agent.stopwatch import Clock


class Deadline:
    """The end of the time that a decision may take; each decision has its own.

    Args:
        clock: never runs backwards.
        budget_s: the time in s; None for as long as it takes, which makes decisions independent of the clock.
    """

    def __init__(self, clock: Clock, budget_s: float | None) -> None:
        self._clock = clock
        self._budget_s = budget_s
        self._begin_s = 0.0

    def begin(self) -> None:
        """A decision begins."""
        if self._budget_s is not None:
            self._begin_s = self._clock()

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return self._budget_s is not None and self._clock() - self._begin_s >= self._budget_s
