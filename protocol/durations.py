"""How often something took how long: what a histogram is made of."""

from bisect import bisect_left
from collections.abc import Sequence

BOUNDS_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""From a fast phase to a decision by the reference solver."""


class Durations:
    """Counts durations; added to on one thread, looked at on any.

    Args:
        bounds_s: upper ends of the classes in s; one more, without end, comes after them.
    """

    def __init__(self, bounds_s: Sequence[float] = BOUNDS_S) -> None:
        self._bounds_s = bounds_s
        self._counts = [0] * (len(bounds_s) + 1)
        self.sum_s = 0.0

    def add(self, duration_s: float) -> None:
        """Something took so long."""
        self._counts[bisect_left(self._bounds_s, duration_s)] += 1
        self.sum_s += duration_s

    def buckets(self) -> list[tuple[str, float]]:
        """As Prometheus wants them: each bound, and how many took no longer."""
        names = [*map(str, self._bounds_s), "+Inf"]
        counts = list(self._counts)
        return [(name, float(sum(counts[: index + 1]))) for index, name in enumerate(names)]
