"""Whether and where this process can be watched."""

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from chassis.health import Durations, VitalSigns
from chassis.service_manager import ServiceManager
from protocol.messages import Truth


class WorldHealth(VitalSigns):
    """Kept by the process about the simulation, which knows nothing of it.

    Args:
        robots: ids of the scenario's robots.
        manager: see :class:`chassis.health.VitalSigns`.
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


class WorldMetrics:
    """A collector: reads what the loop has left in the health, and holds up nothing.

    Args:
        health: of the process.
    """

    def __init__(self, health: WorldHealth) -> None:
        self._health = health
        self.why_not_live = health.why_not_live
        self.why_not_ready = health.why_not_ready

    def collect(self) -> Iterator[Metric]:
        """The metrics with their present values."""
        health = self._health
        ready = float(self.why_not_ready() is None)
        yield GaugeMetricFamily(
            "unspoken_world_ready", "Whether all robots are present, or the run is going.", value=ready
        )
        present = {robot: robot in health.present for robot in health.robots}
        yield _gauge("robot_present", "Whether a robot of the scenario is present.", present)
        yield self._steps()
        yield self._lags()
        yield CounterMetricFamily(
            "unspoken_world_overruns", "Steps that began too late in real time.", value=health.overruns
        )
        if health.truth is not None:
            yield from _of_truth(health.truth)

    def _steps(self) -> Metric:
        return HistogramMetricFamily(
            "unspoken_world_step_seconds",
            "Time from one step to the next, on the wall clock.",
            buckets=self._health.steps.buckets(),
            sum_value=self._health.steps.sum_s,
        )

    def _lags(self) -> Metric:
        family = HistogramMetricFamily(
            "unspoken_world_answer_lag_seconds",
            "Time from the publishing of a step to a robot's command for it.",
            labels=["robot"],
        )
        for robot, lags in self._health.lags.items():
            family.add_metric([robot], lags.buckets(), lags.sum_s)
        return family


def _of_truth(truth: Truth) -> Iterator[Metric]:
    robots = truth.robots
    yield GaugeMetricFamily("unspoken_world_step", "The present step.", value=truth.step)
    yield GaugeMetricFamily("unspoken_world_time_seconds", "Simulated time of that step.", value=truth.time_s)
    arrived = {robot: true.arrived_s is not None for robot, true in robots.items()}
    yield _gauge("robot_arrived", "Whether a robot has arrived.", arrived)
    missed = {robot: true.deadline_misses for robot, true in robots.items()}
    yield _counter("missed_commands", "Steps for which a robot's command did not come in time.", missed)
    clipped = {robot: true.clipped_commands for robot, true in robots.items()}
    yield _counter("clipped_commands", "Commands of a robot that were outside its limits.", clipped)
    yield _refused(truth)
    yield CounterMetricFamily(
        "unspoken_world_collisions", "Pairs of robots that have collided.", value=len(truth.collisions)
    )
    if truth.minimum_distance_m is not None:
        yield GaugeMetricFamily(
            "unspoken_world_minimum_distance_meters",
            "Smallest distance of two robots' centres so far.",
            value=truth.minimum_distance_m,
        )


def _refused(truth: Truth) -> Metric:
    family = CounterMetricFamily(
        "unspoken_world_refused_messages",
        "Commands that the world has not taken.",
        labels=["robot", "reason"],
    )
    for robot, reasons in truth.refused.items():
        for reason, count in reasons.items():
            family.add_metric([robot, reason], count)
    return family


def _gauge(name: str, meaning: str, by_robot: Mapping[str, float]) -> Metric:
    family = GaugeMetricFamily(f"unspoken_world_{name}", meaning, labels=["robot"])
    for robot, value in by_robot.items():
        family.add_metric([robot], float(value))
    return family


def _counter(name: str, meaning: str, by_robot: Mapping[str, int]) -> Metric:
    family = CounterMetricFamily(f"unspoken_world_{name}", meaning, labels=["robot"])
    for robot, value in by_robot.items():
        family.add_metric([robot], value)
    return family


def watched(health: WorldHealth, port: int | None) -> AbstractContextManager[object]:
    """Let the process be watched at this port; None: nobody watches.

    Raises:
        WatchPortError: on entry, the port cannot be used.
    """
    if port is None:
        return nullcontext()
    # Imported for those only that are watched: it takes 0.1 s.
    from chassis.watching import watch_port
    from world.health import WorldMetrics

    return watch_port(WorldMetrics(health), port)
