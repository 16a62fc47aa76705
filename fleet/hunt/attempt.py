"""One run of the hunt: what is tried, what came of it, and how much that hurts."""

import math
import time
from collections.abc import Sequence
from typing import Literal, NamedTuple

from agent.estimate import GoalsName
from chassis.files import Record
from fleet.evaluate.running import described, make_ready
from fleet.inject.scenario import Scenario
from fleet.record.experiment import RunFacts
from fleet.record.summary import Summary, Tally
from fleet.run.virtual import EPOCH, closed_loop
from protocol.messages import PublicScene, Truth

Harm = Literal["distance", "deadlock", "time"]
"""What is looked for: robots that come near, that do not get on, or that take long."""
Points = list[list[float]]
"""Of the unit cube."""
STANDING = 0.05
"""A robot below this share of its speed limit stands."""


class Attempt(NamedTuple):
    """A run to be made."""

    number: int
    """Among all of the hunt."""
    harm: Harm
    start: int
    """Of the search, from which the point comes."""
    scenario: Scenario
    goals: GoalsName
    seed: int

    def without_result(self, reason: str) -> "Outcome":
        """Of a run that ended with an exception, or whose worker died."""
        return Outcome(number=self.number, verdict="failed", reason=" ".join(reason.split()))


class Outcome(Record):
    """What came of a run."""

    number: int
    verdict: str
    """The referee's, or ``failed``."""
    reason: str | None = None
    """Why it failed; None for all others."""
    closest: float | None = None
    """Smallest distance of two robots over their collision distance: less than 1 is contact."""
    missing: int = 0
    """Robots that never arrived."""
    standstill_s: float = 0.0
    """Longest time for which one robot stood before it had arrived."""
    standstill_share: float = 0.0
    """The same over the time limit."""
    slowdown: float | None = None
    """Sum of the times to arrival over that of the same robots, each alone; None where nobody asks for it."""

    @property
    def failed(self) -> bool:
        """Whether it ended with an exception."""
        return self.verdict == "failed"

    @property
    def touched(self) -> bool:
        """Whether bodies overlapped."""
        return self.closest is not None and self.closest < 1.0

    def value(self, harm: Harm) -> float:
        """What the search lowers: the lower, the more it hurts; infinite where there is nothing to judge."""
        if self.failed:
            return math.inf
        if harm == "distance":
            return math.inf if self.closest is None else self.closest
        if harm == "deadlock":
            return -self.missing - self.standstill_share
        return math.inf if self.slowdown is None else -self.slowdown


ENOUGH: dict[Harm, float] = {"distance": 1.0, "deadlock": -1.0 + 1e-9, "time": -math.inf}
"""Below this value there is nothing worse to be looked for nearby: contact; a robot that never arrives."""


def attempt(tried: Attempt) -> Outcome:
    """Make a run in this process; an exception on the way is its outcome."""
    try:
        make_ready(tried.goals, "realtime")
        summary, standstill_s = _driven(tried, tried.scenario)
        limit_s = tried.scenario.time_limit_s
        arrivals_s = [robot.arrived_s for robot in summary.robots]
        distances = summary.relative_distances
        return Outcome(
            number=tried.number,
            verdict=summary.verdict,
            closest=None if distances is None else distances.to_collision.min,
            missing=arrivals_s.count(None),
            standstill_s=standstill_s,
            standstill_share=min(standstill_s / limit_s, 1.0),
            slowdown=_total_s(arrivals_s, limit_s) / _alone_s(tried) if tried.harm == "time" else None,
        )
    except Exception as error:  # whatever it is, the hunt goes on
        return tried.without_result(described(error))


def _alone_s(tried: Attempt) -> float:
    """Sum of the times that the robots take, each alone."""
    scenario = tried.scenario
    alone = [scenario.model_copy(update={"robots": [robot]}) for robot in scenario.robots]
    summaries = [_driven(tried, each)[0] for each in alone]
    arrivals_s = [robot.arrived_s for summary in summaries for robot in summary.robots]
    return _total_s(arrivals_s, scenario.time_limit_s)


def _total_s(arrivals_s: Sequence[float | None], limit_s: float) -> float:
    """Sum of times to arrival; a robot that never arrives takes as long as there is time."""
    return sum(limit_s if arrived_s is None else arrived_s for arrived_s in arrivals_s)


def _driven(tried: Attempt, scenario: Scenario) -> tuple[Summary, float]:
    """The summary of a run, and the longest time in s for which a robot stood before it had arrived."""
    facts = RunFacts.in_virtual_time(scenario, tried.goals, tried.seed, "hunt")
    tally, standstills = Tally(), Standstills(scenario)
    tally.add(PublicScene(epoch=EPOCH, scene=scenario.scene(with_goals=False)))
    for step in closed_loop(scenario, facts, time.thread_time):
        tally.add(step.truth)
        standstills.add(step.truth)
        for decision in step.decisions.values():
            tally.add(decision.mind)
    return tally.summary(facts), standstills.longest_s


class Standstills:
    """Gathers for how long robots stand."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._standing_mps = {robot.id: STANDING * robot.limits.speed_mps for robot in scenario.robots}
        self._steps = dict.fromkeys(self._standing_mps, 0)
        self.longest_s = 0.0

    def add(self, truth: Truth) -> None:
        """Take in a step."""
        for name, robot in truth.robots.items():
            stands = robot.arrived_s is None and abs(robot.state.speed_mps) < self._standing_mps[name]
            self._steps[name] = self._steps[name] + 1 if stands else 0
        self.longest_s = max(self.longest_s, self._scenario.time_s(max(self._steps.values())))
