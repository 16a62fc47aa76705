"""How a robot's process is, and what can be watched of it."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import get_args

from prometheus_client import Histogram
from prometheus_client.core import Metric

from chassis.health import BOUNDS_S, Values, VitalSigns, counter, gauge
from protocol.messages import Degradation, Mind, Observation
from protocol.scene import Goal

LONGEST_QUIET_S = 10.0
"""A robot that has decided before and has not for longer is not ready: nobody shows it where it is."""
PHASES = ("estimate", "predict", "plan", "decide")
"""Of a decision; the last one is the whole of it."""

_Metric = tuple[Callable[..., Metric], str, str, Values, *tuple[str, ...]]
"""Its kind, name, meaning, values, and the label of these, if there are several."""


class RobotHealth(VitalSigns):
    """Kept by the process about the algorithm, which knows nothing of it; collected as metrics.

    All counts are since the start of the process; those in a mind since the robot joined its world.
    """

    def __init__(self, robot: str, goal: Goal, now_s: Callable[[], float] = time.monotonic) -> None:
        super().__init__(now_s)
        self.late = self.withheld = self.refused = 0
        self._robot, self._goal = robot, goal
        self._observation: Observation | None = None
        self._observed_s = 0.0
        self._mind: Mind | None = None
        self._mind_before: Mind | None = None
        self._decided_s: float | None = None
        self._cut_short = 0
        self._degraded: Counter[Degradation] = Counter()
        self._phases = Histogram(
            "unspoken_agent_decision_seconds",
            "Time of each phase of a decision; decide is the whole of it.",
            ["phase"],
            registry=None,
            buckets=BOUNDS_S,
        )
        self._phase = {phase: self._phases.labels(phase) for phase in PHASES}

    def joined(self, robots: int) -> None:
        """The robot is part of a world with so many robots, and can decide."""
        self._mind = self._mind_before = self._decided_s = None
        self.up()
        self.works(f"joined a world of {robots} robots")

    def observed(self, observation: Observation) -> None:
        """An observation was taken, to be decided on."""
        self._observation, self._observed_s = observation, self.now_s()

    def decided(self, mind: Mind) -> None:
        """A decision was made; in time or not."""
        for phase, histogram in self._phase.items():
            if duration_ms := getattr(mind.timings_ms, phase):  # a phase that did not run took none
                histogram.observe(duration_ms / 1000.0)
        self._cut_short += mind.cut_short_at is not None
        self._degraded.update(mind.degraded)
        if self._mind is None or mind.degraded != self._mind.degraded:
            self.works(f"degraded: {', '.join(mind.degraded)}" if mind.degraded else "drives")
        self._mind_before, self._mind = self._mind, mind
        self._decided_s = self.now_s()

    def why_not_ready(self) -> str | None:
        """See :meth:`chassis.health.VitalSigns.why_not_ready`."""
        if why := super().why_not_ready():
            return why
        decided_s = self._decided_s
        if decided_s is None or self.now_s() - decided_s <= LONGEST_QUIET_S:
            return None
        return f"no decision for {self.now_s() - decided_s:.0f} s"

    def collect(self) -> Iterator[Metric]:
        """The metrics with their present values."""
        yield from self._phases.collect()
        for kind, name, meaning, values, *labels in self._metrics():
            yield kind(f"unspoken_agent_{name}", meaning, values, *labels)

    def _metrics(self) -> Iterator[_Metric]:
        ready, mind, observation = self.why_not_ready() is None, self._mind, self._observation
        yield gauge, "ready", "Whether it is part of a world and decisions come.", ready
        yield counter, "late_decisions", "Decisions that came too late to be given.", self.late
        yield counter, "withheld_commands", "Observations that it could not decide on.", self.withheld
        cut_short = "Decisions whose improvement ended with the time budget."
        yield counter, "cut_short_decisions", cut_short, self._cut_short
        yield counter, "refused_messages", "Observations that were not valid.", self.refused
        states = get_args(Degradation)
        now = {state: mind is not None and state in mind.degraded for state in states}
        yield gauge, "degraded", "Whether the last decision was degraded in this way.", now, "state"
        so_far = {state: self._degraded[state] for state in states}
        yield counter, "degraded_decisions", "Decisions that were degraded in this way.", so_far, "state"
        if observation is not None:
            age_s, robots = self.now_s() - self._observed_s, len(observation.robots)
            yield gauge, "observation_age_seconds", "Time since an observation was taken last.", age_s
            view_age = "How many steps old the others are in the last one."
            yield gauge, "view_age_steps", view_age, observation.age_steps
            yield gauge, "robots_seen", "Robots in the last observation, itself included.", robots
        if mind is None:
            return
        yield gauge, "step", "Step of the last decision.", mind.step
        yield gauge, "arrived", "Whether it is at its goal.", mind.arrived
        yield counter, "decisions", "Decisions since it joined its world.", mind.decision + 1
        failures = "Problems not solved since it joined its world."
        yield counter, "solver_failures", failures, mind.solver_failures
        interventions = "How often reserve or last resort held it back since it joined its world."
        yield counter, "interventions", interventions, mind.interventions
        if own := mind.estimates.get(self._robot):  # its own goal is the only one that it knows
            off_m = math.dist((own.x_m, own.y_m), (self._goal.x_m, self._goal.y_m))
            error = "How far its goal is from where the others would estimate it."
            yield gauge, "own_goal_error_meters", error, off_m
        before = self._mind_before.estimates if self._mind_before else {}
        moved_m = {
            robot: math.dist((goal.x_m, goal.y_m), (before[robot].x_m, before[robot].y_m))
            for robot, goal in mind.estimates.items()
            if robot in before
        }
        change = "How far the estimated goal of a robot has moved with the last decision."
        yield gauge, "estimate_change_meters", change, moved_m, "robot"
