"""How a world's process is, and what can be watched of it."""

import time
from collections.abc import Callable, Collection, Iterator

from prometheus_client import Histogram
from prometheus_client.core import Metric

from chassis.health import BOUNDS_S, VitalSigns, counter, gauge
from protocol.messages import Truth


class WorldHealth(VitalSigns):
    """Kept by the process about the simulation, which knows nothing of it; collected as metrics."""

    def __init__(self, robots: tuple[str, ...], now_s: Callable[[], float] = time.monotonic) -> None:
        super().__init__(now_s)
        self.present: Collection[str] = frozenset()
        self._truth: Truth | None = None
        self._overruns = 0
        self._begun_s: float | None = None
        self._answered: set[str] = set()
        self._steps = Histogram(
            "unspoken_world_step_seconds",
            "Time from one step to the next, on the wall clock.",
            registry=None,
            buckets=BOUNDS_S,
        )
        self._lags = Histogram(
            "unspoken_world_answer_lag_seconds",
            "Time from the publishing of a step to a robot's command for it.",
            ["robot"],
            registry=None,
            buckets=BOUNDS_S,
        )
        self._lag_of = {robot: self._lags.labels(robot) for robot in robots}

    def stepped(self, truth: Truth, overruns: int) -> None:
        """A step was published."""
        now_s = self.now_s()
        if self._begun_s is not None:
            self._steps.observe(now_s - self._begun_s)
        self._begun_s = now_s
        self._answered.clear()
        self._truth, self._overruns = truth, overruns

    def answered(self, robots: Collection[str]) -> None:
        """These robots' commands of the present step have been taken."""
        if self._begun_s is not None:
            for robot in set(robots) - self._answered:
                self._lag_of[robot].observe(self.now_s() - self._begun_s)
                self._answered.add(robot)

    def collect(self) -> Iterator[Metric]:
        """The metrics with their present values."""
        ready = self.why_not_ready() is None
        yield gauge("unspoken_world_ready", "Whether all robots are present, or the run is going.", ready)
        yield gauge(
            "unspoken_world_robot_present",
            "Whether a robot of the scenario is present.",
            {robot: robot in self.present for robot in self._lag_of},
            "robot",
        )
        yield from self._steps.collect()
        yield from self._lags.collect()
        yield counter("unspoken_world_overruns", "Steps that began too late in real time.", self._overruns)
        if self._truth is not None:
            yield from _of_truth(self._truth)


def _of_truth(truth: Truth) -> Iterator[Metric]:
    robots = truth.robots.items()
    yield gauge("unspoken_world_step", "The present step.", truth.step)
    yield gauge("unspoken_world_time_seconds", "Simulated time of that step.", truth.time_s)
    yield gauge(
        "unspoken_world_robot_arrived",
        "Whether a robot has arrived.",
        {robot: true.arrived_s is not None for robot, true in robots},
        "robot",
    )
    yield counter(
        "unspoken_world_missed_commands",
        "Steps for which a robot's command did not come in time.",
        {robot: true.deadline_misses for robot, true in robots},
        "robot",
    )
    yield counter(
        "unspoken_world_clipped_commands",
        "Commands of a robot that were outside its limits.",
        {robot: true.clipped_commands for robot, true in robots},
        "robot",
    )
    yield counter(
        "unspoken_world_refused_messages",
        "Commands that the world has not taken.",
        {
            (robot, str(why)): count
            for robot, refused in truth.refused.items()
            for why, count in refused.items()
        },
        "robot",
        "reason",
    )
    yield counter("unspoken_world_collisions", "Pairs of robots that have collided.", len(truth.collisions))
    if truth.minimum_distance_m is not None:
        yield gauge(
            "unspoken_world_minimum_distance_meters",
            "Smallest distance of two robots' centres so far.",
            truth.minimum_distance_m,
        )
