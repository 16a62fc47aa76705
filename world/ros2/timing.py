"""When odometry was measured: its stamps on the robot's clock, told on the clock of this process."""

from collections import deque

WINDOW_S = 10.0
"""For so long the quickest message counts: in this time clocks do not drift apart by a millisecond."""


class Stamps:
    """The stamps of one robot's odometry.

    Its clock may be any time off. The quickest message of the last ``WINDOW_S`` is taken to have come at
    once, and what took longer is older by so much. So a message that was held up on its way, or waited with
    others for a link to come back, is as old as it really is, whatever the robot's clock says; but for the
    time that even the quickest one took.
    """

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._arrived_s = 0.0
        self._offsets: deque[tuple[float, float]] = deque()  # arrivals, offsets: both ascend

    def measured_s(self, stamp_ns: int, arrived_s: float, silence_s: float) -> float | None:
        """When a message was measured, on the clock of the arrivals.

        Args:
            stamp_ns: on the robot's clock.
            arrived_s: when it came.
            silence_s: after so long without a newer one, an older stamp means that the robot's clock has
                been set back, and is believed.

        Returns:
            None for a message that is not newer than the last one.
        """
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            if arrived_s - self._arrived_s <= silence_s:
                return None
            self._offsets.clear()
        self._last_ns, self._arrived_s = stamp_ns, arrived_s
        stamp_s = stamp_ns / 1e9
        self._keep(arrived_s, arrived_s - stamp_s)
        return stamp_s + self._offsets[0][1]

    def _keep(self, arrived_s: float, offset_s: float) -> None:
        """Leave only what may still be the least offset; the first one is."""
        while self._offsets and self._offsets[-1][1] >= offset_s:
            self._offsets.pop()
        self._offsets.append((arrived_s, offset_s))
        while self._offsets[0][0] < arrived_s - WINDOW_S:
            self._offsets.popleft()
