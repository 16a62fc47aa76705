"""Figures of the last seconds."""

from collections import deque
from typing import Final

import numpy as np

from protocol.scene import Settings

WINDOW_S: Final = 5.0
"""What rates and times are of."""
MOST: Final = 5000
"""Values kept of one kind, whatever a robot says in that time."""


class Spread(Settings):
    """Of times in ms."""

    p50: float
    p99: float


class Recent:
    """Values of the last ``WINDOW_S``."""

    def __init__(self) -> None:
        self._values: deque[tuple[float, float]] = deque(maxlen=MOST)

    def add(self, at_s: float, value: float) -> None:
        """A value came at a time."""
        self._values.append((at_s, value))

    def rate_hz(self, now_s: float) -> float | None:
        """How often values come; None where fewer than two came."""
        self._forget(now_s)
        if len(self._values) < 2:
            return None
        return (len(self._values) - 1) / max(now_s - self._values[0][0], 1e-3)

    def spread(self, now_s: float) -> Spread | None:
        """Median and 99th percentile; None where no value came."""
        self._forget(now_s)
        if not self._values:
            return None
        p50, p99 = np.percentile([value for _, value in self._values], (50.0, 99.0)).tolist()
        return Spread(p50=p50, p99=p99)

    def _forget(self, now_s: float) -> None:
        while self._values and self._values[0][0] < now_s - WINDOW_S:
            self._values.popleft()
