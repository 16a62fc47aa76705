"""The summary of a run: what ``summary.json`` says."""

from array import array
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from chassis.files import write_whole
from fleet.record.report_file import Record
from fleet.record.stream import RefusedMind, Restarted
from fleet.run.experiment import RunFacts
from protocol.messages import Message, Mind, PublicScene, TrueRobot, Truth


class RobotSummary(Record):
    """One robot's part."""

    id: str
    arrived_s: float | None
    """None: it never arrived."""
    driven_m: float
    solver_failures: int
    deadline_misses: int


class PhaseDurations(Record):
    """Percentiles of one phase's wall-clock time, in ms, over all robots' decisions in which it ran.

    None where it never ran: nothing was measured, which is not the same as no time.
    """

    p50: float | None
    p99: float | None
    max: float | None


class Phases(Record):
    """The phases of a decision; ``decide`` is the whole."""

    estimate: PhaseDurations
    predict: PhaseDurations
    plan: PhaseDurations
    decide: PhaseDurations


class Summary(Record):
    """One run. In JSON the version stands under ``schema``."""

    version: Literal[1] = Field(default=1, alias="schema")
    scenario: str
    goals: str
    solver: str
    iterations: int
    """Most of the real-time solver for one problem."""
    budget_ms: float | None
    """For a decision with the real-time solver; None for no limit."""
    clock: str
    seed: int
    verdict: str
    """The referee's, or ``interrupted`` or ``failed`` where the run ended without one."""
    duration_s: float | None
    """When the last robot arrived; None unless all did."""
    steps: int
    collisions: int
    """Number of pairs that collided."""
    minimum_distance_m: float | None
    """None with a single robot."""
    solver_failures: int
    deadline_misses: int
    clipped_commands: int
    refused: dict[str, dict[str, int]]
    """Messages that were not taken, by robot and reason; reasons of minds begin with ``mind:``."""
    interventions: int = 0
    """How often last-resort collision monitors have begun to brake."""
    degraded: dict[str, dict[str, float]] = Field(default_factory=dict)
    """In which ways robots were degraded and for how long, in s; only those that were."""
    restarts: dict[str, int] = Field(default_factory=dict)
    """How often processes were started again, by their name; only those that were."""
    robots: tuple[RobotSummary, ...]
    phases_ms: Phases

    def write(self, path: Path) -> None:
        """Write the JSON file so that it is never seen half written.

        Raises:
            OSError: it cannot be written; an older file is then left as it was.
        """
        write_whole(path, self.model_dump_json(by_alias=True, indent=2) + "\n")


class Tally:
    """Counts up a run from its messages, as they come or from a recording.

    Where the world was started again in between, the messages of its last epoch count.
    """

    def __init__(self) -> None:
        self._restarts: Counter[str] = Counter()
        self._epoch: int | None = None
        self._begin()

    def _begin(self) -> None:
        self._truth: Truth | None = None
        self._robots: dict[str, TrueRobot] = {}
        self._solver_failures: dict[str, int] = {}
        self._interventions: dict[str, int] = {}
        self._degraded: dict[str, Counter[str]] = {}
        self._refused_minds: dict[str, Counter[str]] = {}
        self._durations_ms = {phase: array("d") for phase in Phases.model_fields}

    def add(self, message: Message) -> None:
        """Count a truth or a mind, in the order of their steps; other messages tell nothing more."""
        if isinstance(message, PublicScene | Truth) and message.epoch != self._epoch:
            self._epoch = message.epoch
            self._begin()
        if isinstance(message, Truth):
            self._truth = message
            # A robot that has vanished keeps what it had reached.
            self._robots.update(message.robots)
        elif isinstance(message, Mind):
            self._solver_failures[message.robot] = message.solver_failures
            self._interventions[message.robot] = message.interventions
            self._degraded.setdefault(message.robot, Counter()).update(message.degraded)
            for phase, durations_ms in self._durations_ms.items():
                duration_ms = getattr(message.timings_ms, phase)
                if duration_ms > 0.0:
                    durations_ms.append(duration_ms)

    def refuse(self, refused: RefusedMind) -> None:
        """Count minds that were not taken."""
        self._refused_minds.setdefault(refused.robot, Counter())[f"mind: {refused.reason}"] += (
            refused.how_many
        )

    def count_restart(self, restarted: Restarted) -> None:
        """Count a process that was started again."""
        self._restarts[restarted.process] += 1

    @property
    def refused(self) -> dict[str, dict[str, int]]:
        """Messages that were not taken so far, by robot and reason."""
        counts: dict[str, dict[str, int]] = {}
        commands = self._truth.refused if self._truth else {}
        for of_one_kind in (commands, self._refused_minds):
            for robot, reasons in of_one_kind.items():
                counts.setdefault(robot, {}).update({str(reason): count for reason, count in reasons.items()})
        return counts

    @property
    def clipped_commands(self) -> dict[str, int]:
        """Commands outside the limits so far, by robot."""
        return {name: robot.clipped_commands for name, robot in self._robots.items()}

    def summary(self, facts: RunFacts, without_verdict: str = "interrupted") -> Summary:
        """The run so far.

        Args:
            facts: what the run is.
            without_verdict: the verdict where the referee could not give one.
        """
        truth = self._truth
        return Summary(
            scenario=facts.scenario,
            goals=facts.goals,
            solver=facts.solver,
            iterations=facts.iterations,
            budget_ms=facts.budget_ms,
            clock=facts.clock,
            seed=facts.seed,
            verdict=(truth and truth.verdict) or without_verdict,
            duration_s=self._duration_s(),
            steps=truth.step if truth else 0,
            collisions=len(truth.collisions) if truth else 0,
            minimum_distance_m=truth.minimum_distance_m if truth else None,
            solver_failures=sum(self._solver_failures.values()),
            deadline_misses=sum(robot.deadline_misses for robot in self._robots.values()),
            clipped_commands=sum(self.clipped_commands.values()),
            refused=self.refused,
            interventions=sum(self._interventions.values()),
            degraded=self._degraded_s(truth),
            restarts=dict(self._restarts),
            robots=tuple(self._robot(name, robot) for name, robot in self._robots.items()),
            phases_ms=Phases(**{name: _percentiles(values) for name, values in self._durations_ms.items()}),
        )

    def _degraded_s(self, truth: Truth | None) -> dict[str, dict[str, float]]:
        """Steps in seconds, to the nanosecond."""
        step_s = truth.time_s / truth.step if truth and truth.step else 0.0
        return {
            robot: {how: round(steps * step_s, 9) for how, steps in sorted(ways.items())}
            for robot, ways in sorted(self._degraded.items())
            if ways
        }

    def _duration_s(self) -> float | None:
        arrivals_s = [robot.arrived_s for robot in self._robots.values()]
        arrived_s = [time_s for time_s in arrivals_s if time_s is not None]
        return max(arrived_s) if arrived_s and len(arrived_s) == len(arrivals_s) else None

    def _robot(self, name: str, robot: TrueRobot) -> RobotSummary:
        return RobotSummary(
            id=name,
            arrived_s=robot.arrived_s,
            driven_m=robot.driven_m,
            solver_failures=self._solver_failures.get(name, 0),
            deadline_misses=robot.deadline_misses,
        )


def _percentiles(values: Sequence[float]) -> PhaseDurations:
    if not values:
        return PhaseDurations(p50=None, p99=None, max=None)
    p50, p99, most = np.percentile(values, [50.0, 99.0, 100.0]).tolist()
    return PhaseDurations(p50=p50, p99=p99, max=most)
