"""What Prometheus is told of a robot's process."""

import math
from collections.abc import Iterator
from typing import get_args

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from agent.health import RobotHealth
from protocol.messages import Degradation, Mind, State


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
