"""Times the phases of a decision with a clock that the caller brings: the core itself reads none."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from protocol.messages import Timings

Clock = Callable[[], float]
"""Seconds from any fixed point; never runs backwards."""


class Stopwatch:
    """Milliseconds spent in each phase of one decision, and in the whole of it so far."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._start = clock()
        self._phases: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Time the enclosed work as one phase."""
        begin = self._clock()
        try:
            yield
        finally:
            self._phases[name] = 1e3 * (self._clock() - begin)

    def timings(self) -> Timings:
        """The phases timed so far; ``decide`` runs from the making of the stopwatch until now."""
        return Timings(**self._phases, decide=1e3 * (self._clock() - self._start))
