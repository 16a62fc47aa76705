"""One trial: a case with a number of robots and a seed."""

import time
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from agent.estimate import GoalsName
from fleet.evaluate.running import described, make_ready
from fleet.faults.cases import Case
from fleet.faults.invariants import Evidence, violations
from fleet.run.experiment import VIRTUAL, RunFacts
from fleet.run.virtual import closed_loop
from fleet.scenarios.families import FAMILIES
from protocol.scenario import Scenario

TIME_LIMIT_S = 40.0
"""Of a crossing, which takes about ten without faults."""
STREAM = 6
"""Sets the scenarios of trials apart from those of other suites with the same seeds."""


class Trial(NamedTuple):
    """What to try."""

    case: Case
    robots: int
    seed: int
    goals: GoalsName

    def scenario(self) -> Scenario:
        """A crossing of the publication's kind, drawn by the seed, with the faults of the case."""
        drawn = FAMILIES["perimeter"](self.robots, np.random.default_rng((STREAM, self.seed, self.robots)))
        name = f"{self.case.name}-{self.robots}-{self.seed}"
        changes = {"name": name, "faults": self.case.faults, "time_limit_s": TIME_LIMIT_S}
        return drawn.model_copy(update=changes)


class Outcome(BaseModel):
    """What came of a trial."""

    model_config = ConfigDict(frozen=True)

    case: str
    robots: int
    seed: int
    verdict: str | None
    """None: there is none, or an exception came before it."""
    time_s: float
    """When the run ended, since step 0."""
    collisions: int
    interventions: int
    violations: tuple[str, ...]
    """What did not hold; empty if everything did."""
    wall_s: float


def execute(trial: Trial) -> Outcome:
    """Make a trial in virtual time; an exception on the way is a violation."""
    begin_s = time.perf_counter()
    evidence, scenario = Evidence(), trial.scenario()
    try:
        make_ready(trial.goals, "realtime")
        for moment in closed_loop(scenario, _facts(trial, scenario), time.thread_time):
            evidence.add(moment.truth)
            for decision in moment.decisions.values():
                evidence.add(decision.mind)
        found = violations(trial.case, scenario, trial.seed, evidence)
    except Exception as error:  # whatever it is, it must not happen, and the other trials go on
        found = [described(error)]
    return outcome(trial, evidence, found, time.perf_counter() - begin_s)


def outcome(trial: Trial, evidence: Evidence, found: list[str], wall_s: float) -> Outcome:
    """A trial's result from what is known of it."""
    end = evidence.end
    return Outcome(
        case=trial.case.name,
        robots=trial.robots,
        seed=trial.seed,
        verdict=end.verdict if end else None,
        time_s=end.time_s if end else 0.0,
        collisions=sum(len(epoch.truths[-1].collisions) for epoch in evidence.epochs if epoch.truths),
        interventions=sum(sum(epoch.interventions.values()) for epoch in evidence.epochs),
        violations=tuple(found),
        wall_s=round(wall_s, 3),
    )


def without_result(trial: Trial, reason: str) -> Outcome:
    """Of a trial that could not be made."""
    return outcome(trial, Evidence(), [reason], 0.0)


def _facts(trial: Trial, scenario: Scenario) -> RunFacts:
    return RunFacts(
        scenario=scenario.name,
        goals=trial.goals,
        solver="realtime",
        clock=VIRTUAL,
        seed=trial.seed,
        faults=len(scenario.faults),
        run="trial",
        version=version("unspoken"),
    )
