"""Whether and where this process can be watched."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import get_args

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from chassis.health import Durations, VitalSigns
from chassis.service_manager import ServiceManager
from protocol.messages import Degradation, Mind, Observation, State
from protocol.scene import Goal

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
        manager: see :class:`chassis.health.VitalSigns`.
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
        """See :meth:`chassis.health.VitalSigns.why_not_ready`."""
        if why := super().why_not_ready():
            return why
        decided_s = self.decided_s
        if decided_s is None or self.now_s() - decided_s <= LONGEST_QUIET_S:
            return None
        return f"no decision for {self.now_s() - decided_s:.0f} s"


class RobotMetrics:
    """A collector: reads what the loop has left in the health, and holds up nothing.

    Args:
        health: of the process.
    """

    def __init__(self, health: RobotHealth) -> None:
        self._health = health
        self.why_not_live = health.why_not_live
        self.why_not_ready = health.why_not_ready

    def collect(self) -> Iterator[Metric]:
        """The metrics with their present values."""
        health, mind = self._health, self._health.mind
        yield _gauge(
            "ready", "Whether it is part of a world and decisions come.", self.why_not_ready() is None
        )
        yield self._phases()
        yield _counter("late_decisions", "Decisions that came too late to be given.", health.late)
        yield _counter("withheld_commands", "Observations that it could not decide on.", health.withheld)
        yield _counter(
            "cut_short_decisions", "Decisions whose improvement ended with the time budget.", health.cut_short
        )
        yield _counter("refused_messages", "Observations that were not valid.", health.refused)
        yield self._degraded(mind)
        yield self._degraded_decisions()
        if mind is not None:
            yield from _of_mind(mind)
            yield from self._estimates(mind)
        yield from self._observation()

    def _phases(self) -> Metric:
        family = HistogramMetricFamily(
            "unspoken_agent_decision_seconds",
            "Time of each phase of a decision; decide is the whole of it.",
            labels=["phase"],
        )
        for phase, durations in self._health.phases.items():
            family.add_metric([phase], durations.buckets(), durations.sum_s)
        return family

    def _degraded(self, mind: Mind | None) -> Metric:
        family = GaugeMetricFamily(
            "unspoken_agent_degraded", "Whether the last decision was degraded in this way.", labels=["state"]
        )
        for state in get_args(Degradation):
            family.add_metric([state], float(mind is not None and state in mind.degraded))
        return family

    def _degraded_decisions(self) -> Metric:
        family = CounterMetricFamily(
            "unspoken_agent_degraded_decisions", "Decisions that were degraded in this way.", labels=["state"]
        )
        for state in get_args(Degradation):
            family.add_metric([state], self._health.degraded[state])
        return family

    def _estimates(self, mind: Mind) -> Iterator[Metric]:
        """Its own goal is the only one that it knows: there it sees how good the estimates are."""
        goal, estimates = self._health.goal, mind.estimates
        if own := estimates.get(self._health.robot):
            error_m = math.hypot(own.x_m - goal.x_m, own.y_m - goal.y_m)
            yield _gauge(
                "own_goal_error_meters",
                "How far its goal is from where the others would estimate it.",
                error_m,
            )
        before = self._health.mind_before
        family = GaugeMetricFamily(
            "unspoken_agent_estimate_change_meters",
            "How far the estimated goal of a robot has moved with the last decision.",
            labels=["robot"],
        )
        for robot, estimate in estimates.items():
            if before is not None and robot in before.estimates:
                family.add_metric([robot], _distance_m(estimate, before.estimates[robot]))
        yield family

    def _observation(self) -> Iterator[Metric]:
        observation, observed_s = self._health.observation, self._health.observed_s
        if observation is None or observed_s is None:
            return
        age_s = self._health.now_s() - observed_s
        yield _gauge("observation_age_seconds", "Time since an observation was taken last.", age_s)
        yield _gauge(
            "view_age_steps", "How many steps old the others are in the last one.", observation.age_steps
        )
        yield _gauge(
            "robots_seen", "Robots in the last observation, itself included.", len(observation.robots)
        )


def _of_mind(mind: Mind) -> Iterator[Metric]:
    yield _gauge("step", "Step of the last decision.", mind.step)
    yield _gauge("arrived", "Whether it is at its goal.", mind.arrived)
    yield _counter("decisions", "Decisions since it joined its world.", mind.decision + 1)
    yield _counter("solver_failures", "Problems not solved since it joined its world.", mind.solver_failures)
    yield _counter(
        "interventions",
        "How often the collision monitor has begun to brake since it joined its world.",
        mind.interventions,
    )


def _distance_m(one: State, other: State) -> float:
    return math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)


def _gauge(name: str, meaning: str, value: float) -> Metric:
    return GaugeMetricFamily(f"unspoken_agent_{name}", meaning, value=float(value))


def _counter(name: str, meaning: str, value: float) -> Metric:
    return CounterMetricFamily(f"unspoken_agent_{name}", meaning, value=float(value))


def watched(health: RobotHealth, port: int | None) -> AbstractContextManager[object]:
    """Let the process be watched at this port; None: nobody watches.

    Raises:
        WatchPortError: on entry, the port cannot be used.
    """
    if port is None:
        return nullcontext()
    # Imported for those only that are watched: it takes 0.1 s.
    from agent.process.health import RobotMetrics
    from chassis.watching import watch_port

    return watch_port(RobotMetrics(health), port)
