"""How a robot's process is: what its loop reports, for whoever watches it."""

import time
from collections import Counter
from collections.abc import Callable

from protocol.durations import Durations
from protocol.messages import Degradation, Mind, Observation
from protocol.scene import Goal
from protocol.service_manager import ServiceManager
from protocol.vital_signs import VitalSigns

LONGEST_QUIET_S = 10.0
"""A robot that has decided before and has not for longer is not ready: nobody shows it where it is."""
PHASES = ("estimate", "predict", "plan", "decide")
"""Of a decision; the last one is the whole of it."""


class RobotHealth(VitalSigns):
    """Kept by the process about the algorithm, which knows nothing of it.

    All counts are since the start of the process; those in ``mind`` since the robot joined its world.

    Args:
        robot: its id.
        goal: its own.
        manager: see :class:`protocol.vital_signs.VitalSigns`.
        now_s: a monotonic clock.
    """

    def __init__(
        self,
        robot: str,
        goal: Goal,
        manager: ServiceManager | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(manager, now_s)
        self.robot = robot
        self.goal = goal
        self.phases = {phase: Durations() for phase in PHASES}
        self.observation: Observation | None = None
        self.observed_s: float | None = None
        self.mind: Mind | None = None
        self.mind_before: Mind | None = None
        self.decided_s: float | None = None
        self.late = 0
        self.withheld = 0
        self.cut_short = 0
        self.refused = 0
        self.degraded: Counter[Degradation] = Counter()

    def joined(self, robots: int) -> None:
        """The robot is part of a world with so many robots, and can decide."""
        self.mind = self.mind_before = self.decided_s = None
        self.up()
        self.works(f"joined a world of {robots} robots")

    def observed(self, observation: Observation) -> None:
        """An observation was taken, to be decided on."""
        self.observation, self.observed_s = observation, self.now_s()

    def decided(self, mind: Mind) -> None:
        """A decision was made; in time or not."""
        for phase, durations in self.phases.items():
            if duration_ms := getattr(mind.timings_ms, phase):  # a phase that did not run took none
                durations.add(duration_ms / 1000.0)
        self.cut_short += mind.cut_short_at is not None
        self.degraded.update(mind.degraded)
        if self.mind is None or mind.degraded != self.mind.degraded:
            how = f"degraded: {', '.join(mind.degraded)}" if mind.degraded else "drives"
            self.works(how)
        self.mind_before, self.mind = self.mind, mind
        self.decided_s = self.now_s()

    def why_not_ready(self) -> str | None:
        """See :meth:`protocol.vital_signs.VitalSigns.why_not_ready`."""
        if why := super().why_not_ready():
            return why
        decided_s = self.decided_s
        if decided_s is None or self.now_s() - decided_s <= LONGEST_QUIET_S:
            return None
        return f"no decision for {self.now_s() - decided_s:.0f} s"
