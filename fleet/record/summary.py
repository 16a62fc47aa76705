"""The summary of a run: what ``summary.json`` holds, and what the terminal says at the end."""

from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import Field
from rich import box
from rich.table import Table

from chassis.files import Record
from fleet.record.encounters import Encounters, RelativeDistances
from fleet.record.experiment import RunFacts
from fleet.record.recording import RefusedMind, Restarted
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
    reserve: bool = True
    """Whether robots kept it."""
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
    """How often the reserve or the last resort has begun to hold a robot back, over all robots."""
    degraded: dict[str, dict[str, float]] = Field(default_factory=dict)
    """In which ways robots were degraded and for how long, in s; only those that were."""
    restarts: dict[str, int] = Field(default_factory=dict)
    """How often processes were started again, by their name; only those that were."""
    relative_distances: RelativeDistances | None = None
    """None with a single robot."""
    side_disagreement: float | None = None
    """Share of ``side_pair_steps`` in which two robots predict to pass each other on different sides."""
    side_pair_steps: int = 0
    """Pairs that predict to come near each other, added up over the steps."""
    warnings: tuple[str, ...] = ()
    """Why the scenario cannot be safe, whatever robots do; a sentence each."""
    robots: tuple[RobotSummary, ...]
    phases_ms: Phases


_FACTS = {"scenario", "goals", "solver", "iterations", "budget_ms", "reserve", "clock", "seed"}


class Tally:
    """Counts up a run from its messages, as they come or from a recording.

    Where the world was started again in between, the messages of its last epoch count.
    """

    def __init__(self) -> None:
        self._restarts: Counter[str] = Counter()
        self._encounters = Encounters()
        self._begin(None)

    def _begin(self, epoch: int | None) -> None:
        self._epoch = epoch
        self._encounters.begin()
        self._truth: Truth | None = None
        self._robots: dict[str, TrueRobot] = {}
        self._minds: dict[str, Mind] = {}
        self._degraded: dict[str, Counter[str]] = {}
        self._refused_minds: dict[str, Counter[str]] = {}
        self._durations_ms = {phase: array("d") for phase in Phases.model_fields}

    def add(self, item: Message | RefusedMind | Restarted) -> None:
        """Count what a run tells, in the order of its steps; a pose or a command tells nothing more."""
        if isinstance(item, PublicScene | Truth) and item.epoch != self._epoch:
            self._begin(item.epoch)
        if isinstance(item, PublicScene):
            self._encounters.meet(item.scene)
        elif isinstance(item, Truth):
            self._encounters.measure(item)
            self._truth = item
            self._robots.update(item.robots)  # a robot that has vanished keeps what it had reached
        elif isinstance(item, Mind):
            self._encounters.compare(item)
            self._minds[item.robot] = item
            self._degraded.setdefault(item.robot, Counter()).update(item.degraded)
            for phase, durations_ms in self._durations_ms.items():
                duration_ms = getattr(item.timings_ms, phase)
                if duration_ms > 0.0:
                    durations_ms.append(duration_ms)
        elif isinstance(item, RefusedMind):
            reasons = self._refused_minds.setdefault(item.robot, Counter())
            reasons[f"mind: {item.reason}"] += item.how_many
        elif isinstance(item, Restarted):
            self._restarts[item.process] += 1

    @property
    def clipped_commands(self) -> dict[str, int]:
        """Commands outside the limits so far, by robot."""
        return {name: robot.clipped_commands for name, robot in self._robots.items()}

    def summary(
        self, facts: RunFacts, without_verdict: str = "interrupted", warnings: Sequence[str] = ()
    ) -> Summary:
        """The run so far; without the referee's verdict, the given one stands.

        Args:
            facts: what was run.
            without_verdict: see above.
            warnings: of the scenario.
        """
        truth, robots, minds = self._truth, self._robots, self._minds
        arrivals_s = [robot.arrived_s for robot in robots.values() if robot.arrived_s is not None]
        return Summary(
            **facts.model_dump(include=_FACTS),
            verdict=(truth and truth.verdict) or without_verdict,
            duration_s=max(arrivals_s) if arrivals_s and len(arrivals_s) == len(robots) else None,
            steps=truth.step if truth else 0,
            collisions=len(truth.collisions) if truth else 0,
            minimum_distance_m=truth.minimum_distance_m if truth else None,
            solver_failures=sum(mind.solver_failures for mind in minds.values()),
            deadline_misses=sum(robot.deadline_misses for robot in robots.values()),
            clipped_commands=sum(self.clipped_commands.values()),
            refused=self._refused(),
            interventions=sum(mind.interventions for mind in minds.values()),
            degraded=self._degraded_s(),
            restarts=dict(self._restarts),
            relative_distances=self._encounters.relative_distances,
            side_disagreement=self._encounters.side_disagreement,
            side_pair_steps=self._encounters.pair_steps,
            warnings=tuple(warnings),
            robots=tuple(
                RobotSummary(
                    id=name,
                    arrived_s=robot.arrived_s,
                    driven_m=robot.driven_m,
                    solver_failures=minds[name].solver_failures if name in minds else 0,
                    deadline_misses=robot.deadline_misses,
                )
                for name, robot in robots.items()
            ),
            phases_ms=Phases(**{name: _percentiles(values) for name, values in self._durations_ms.items()}),
        )

    def _refused(self) -> dict[str, dict[str, int]]:
        commands = self._truth.refused if self._truth else {}
        counts = {
            robot: {str(reason): count for reason, count in of.items()} for robot, of in commands.items()
        }
        for robot, reasons in self._refused_minds.items():
            counts.setdefault(robot, {}).update(reasons)
        return counts

    def _degraded_s(self) -> dict[str, dict[str, float]]:
        """Steps in seconds, to the nanosecond."""
        truth = self._truth
        step_s = truth.time_s / truth.step if truth and truth.step else 0.0
        return {
            robot: {how: round(steps * step_s, 9) for how, steps in sorted(ways.items())}
            for robot, ways in sorted(self._degraded.items())
            if ways
        }


def _percentiles(values: Sequence[float]) -> PhaseDurations:
    if not values:
        return PhaseDurations(p50=None, p99=None, max=None)
    p50, p99, most = np.percentile(values, [50.0, 99.0, 100.0]).tolist()
    return PhaseDurations(p50=p50, p99=p99, max=most)


NAMED_ROBOTS = 5
"""More robots than this are counted instead of named."""
_OPENINGS = {"timeout": "Out of time"}


def robot_table(summary: Summary, clipped_commands: Mapping[str, int]) -> Table:
    """One row a robot and one for the run; fits into 80 columns. Clipped commands are given by robot."""
    table = Table(box=box.SIMPLE_HEAD, show_footer=len(summary.robots) > 1)
    table.add_column("Robot", "all", overflow="fold")
    for header, total in (
        ("Arrived\nin s", _arrival(summary.duration_s)),
        ("Driven\nin m", f"{sum(robot.driven_m for robot in summary.robots):.2f}"),
        ("Solver\nfailures", _count(summary.solver_failures)),
        ("Deadline\nmisses", _count(summary.deadline_misses)),
        ("Commands\nclipped", _count(summary.clipped_commands)),
    ):
        table.add_column(header, total, justify="right")
    for robot in summary.robots:
        counts = (robot.solver_failures, robot.deadline_misses, clipped_commands[robot.id])
        table.add_row(robot.id, _arrival(robot.arrived_s), f"{robot.driven_m:.2f}", *map(_count, counts))
    return table


def verdict_line(summary: Summary, step_s: float) -> str:
    """How a run with this Δt in s ended, in a sentence or two of plain text."""
    opening = _OPENINGS.get(summary.verdict, summary.verdict.capitalize())
    count = len(summary.robots)
    if not count:
        return f"{opening} before the first step."
    everybody = {1: "The robot", 2: "Both robots"}.get(count, f"All {count} robots")
    collided = "1 pair" if summary.collisions == 1 else f"{summary.collisions} pairs"
    distance = ""
    if summary.minimum_distance_m is not None:
        distance = f"; smallest distance {summary.minimum_distance_m:.2f} m"
    if summary.verdict == "arrived" and summary.duration_s is not None:
        harm = f", but {collided} of robots collided" if summary.collisions else ""
        unharmed = " without collision" if distance and not harm else ""
        return f"{everybody} arrived after {summary.duration_s:.1f} s{harm}{unharmed}{distance}."
    ended = f"after {summary.steps * step_s:.1f} s"
    progress = _progress(summary) or f"{everybody.lower()} had arrived"
    if summary.verdict == "collision":
        return f"Collision of {collided} of robots; {ended} {progress}{distance}."
    harm = f" {collided} of robots collided." if summary.collisions else ""
    return f"{opening} {ended}: {progress}{distance}.{harm}"


def _progress(summary: Summary) -> str:
    """Who has not arrived; nothing where all have."""
    missing = [robot.id for robot in summary.robots if robot.arrived_s is None]
    if not missing:
        return ""
    verb = "never arrived" if summary.verdict == "deadlock" else "had not arrived"
    if len(missing) == 1:
        return f"robot {missing[0]} {verb}"
    if len(missing) > NAMED_ROBOTS:
        return f"{len(missing)} of {len(summary.robots)} robots {verb}"
    return f"robots {', '.join(missing[:-1])} and {missing[-1]} {verb}"


def remarks(summary: Summary) -> list[str]:
    """What was not taken of messages, who drove degraded and so on: nothing if all is well."""
    refused = [
        f"Refused of robot {robot}: {', '.join(f'{count} × {reason}' for reason, count in reasons.items())}."
        for robot, reasons in summary.refused.items()
    ]
    degraded = [
        f"Robot {robot} was degraded: {', '.join(f'{how} {time_s:g} s' for how, time_s in ways.items())}."
        for robot, ways in summary.degraded.items()
    ]
    sides = []
    if summary.side_disagreement:
        sides.append(
            f"In {summary.side_disagreement:.1%} of {summary.side_pair_steps} pair-steps two robots "
            "predicted to pass each other on different sides."
        )
    reserve = [] if summary.reserve else ["All drove without reserve."]
    return reserve + refused + degraded + sides


def _arrival(time_s: float | None) -> str:
    return "[red]–[/]" if time_s is None else f"{time_s:.1f}"


def _count(number: int) -> str:
    return f"[yellow]{number}[/]" if number else "0"
