"""What Prometheus is told of a world's process."""

from collections.abc import Iterator, Mapping

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from protocol.messages import Truth
from world.health import WorldHealth


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
