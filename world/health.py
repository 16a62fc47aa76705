"""How a world's process is: what its loop reports, for whoever watches it."""

import time
from collections.abc import Callable, Collection

from protocol.durations import Durations
from protocol.messages import Truth
from protocol.service_manager import ServiceManager
from protocol.vital_signs import VitalSigns


class WorldHealth(VitalSigns):
    """Kept by the process about the simulation, which knows nothing of it.

    Args:
        robots: ids of the scenario's robots.
        manager: see :class:`protocol.vital_signs.VitalSigns`.
        now_s: a monotonic clock.
    """

    def __init__(
        self,
        robots: tuple[str, ...],
        manager: ServiceManager | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(manager, now_s)
        self.robots = robots
        self.present: Collection[str] = frozenset()
        self.truth: Truth | None = None
        self.overruns = 0
        self.steps = Durations()
        self.lags = {robot: Durations() for robot in robots}
        self._begun_s: float | None = None
        self._answered: set[str] = set()

    def stepped(self, truth: Truth, overruns: int) -> None:
        """A step was published."""
        now_s = self.now_s()
        if self._begun_s is not None:
            self.steps.add(now_s - self._begun_s)
        self._begun_s = now_s
        self._answered.clear()
        self.truth, self.overruns = truth, overruns

    def answered(self, robots: Collection[str]) -> None:
        """These robots' commands of the present step have been taken."""
        if self._begun_s is not None:
            for robot in set(robots) - self._answered:
                self.lags[robot].add(self.now_s() - self._begun_s)
                self._answered.add(robot)
