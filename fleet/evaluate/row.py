"""One finished run: a row of ``runs.csv``. Its columns have their one home here."""

from typing import Annotated, Any, NamedTuple, Self

from pydantic import Field

from fleet.evaluate.noise import NoiseLevel
from fleet.record.report_file import Record
from fleet.record.summary import Phases, Summary

FAILED = "failed"
"""The verdict of a run that ended with an exception."""
DIED = "the worker process died each time that this was tried"
"""The reason of a run that took its process along."""
_LONGEST_REASON = 500

Line = Annotated[str, Field(pattern=r"^[^\r\n]*$")]
"""Text without a line break: a row is one line of the file."""


class RunKey(NamedTuple):
    """What tells a run from all others of an evaluation."""

    scenario: str
    method: str
    solver: str
    noise: str
    seed: int


class Row(Record):
    """One run. Its columns are the fields, in this order; an empty cell is None.

    A run that failed has nothing but its key, the number of robots, the verdict and the reason.
    """

    scenario: Line
    """The stem of its file."""
    robots: int
    method: Line
    """How the robots come to know goals."""
    solver: Line
    noise: NoiseLevel
    seed: int
    verdict: Line
    """The referee's, or ``failed``."""
    reason: Line | None = None
    """Why it failed; None for all others."""
    duration_s: float | None = None
    """When the last robot arrived; None unless all did."""
    robot_duration_mean_s: float | None = None
    """Mean over the robots of when each arrived; None unless all did."""
    driven_m: float | None = None
    """By all robots together."""
    robot_driven_mean_m: float | None = None
    minimum_distance_m: float | None = None
    """None with a single robot too."""
    collisions: int | None = None
    """Pairs of robots."""
    arrived: int | None = None
    """Robots."""
    steps: int | None = None
    solver_failures: int | None = None
    clipped_commands: int | None = None
    estimate_cpu_p50_ms: float | None = None
    """Of the thread CPU time of one decision's phase, over all robots and steps in which it ran."""
    estimate_cpu_p99_ms: float | None = None
    estimate_cpu_max_ms: float | None = None
    predict_cpu_p50_ms: float | None = None
    predict_cpu_p99_ms: float | None = None
    predict_cpu_max_ms: float | None = None
    plan_cpu_p50_ms: float | None = None
    plan_cpu_p99_ms: float | None = None
    plan_cpu_max_ms: float | None = None
    decide_cpu_p50_ms: float | None = None
    decide_cpu_p99_ms: float | None = None
    decide_cpu_max_ms: float | None = None
    cpu_s: float | None = None
    """Thread CPU time of the whole run, world included."""
    wall_s: float | None = None

    @property
    def key(self) -> RunKey:
        """Which run it is."""
        return RunKey(self.scenario, self.method, self.solver, self.noise, self.seed)

    @property
    def failed(self) -> bool:
        """Whether the run ended with an exception."""
        return self.verdict == FAILED

    @classmethod
    def finished(cls, key: RunKey, summary: Summary, cpu_s: float, wall_s: float) -> Self:
        """The row of a run that has come to a verdict.

        Args:
            key: which run it is.
            summary: of the run; its decisions were timed with the thread's CPU clock.
            cpu_s: of the whole run.
            wall_s: of the whole run.
        """
        arrivals_s = [robot.arrived_s for robot in summary.robots if robot.arrived_s is not None]
        robots = len(summary.robots)
        all_arrived = len(arrivals_s) == robots
        driven_m = sum(robot.driven_m for robot in summary.robots)
        return cls(
            **key._asdict(),
            robots=robots,
            verdict=summary.verdict,
            duration_s=summary.duration_s,
            robot_duration_mean_s=sum(arrivals_s) / robots if all_arrived else None,
            driven_m=driven_m,
            robot_driven_mean_m=driven_m / robots,
            minimum_distance_m=summary.minimum_distance_m,
            collisions=summary.collisions,
            arrived=len(arrivals_s),
            steps=summary.steps,
            solver_failures=summary.solver_failures,
            clipped_commands=summary.clipped_commands,
            cpu_s=cpu_s,
            wall_s=wall_s,
            **_timings(summary.phases_ms),
        )

    @classmethod
    def without_result(cls, key: RunKey, robots: int, reason: str) -> Self:
        """The row of a run that failed, for a reason that is put on one line."""
        line = " ".join(reason.split())[:_LONGEST_REASON]
        return cls(**key._asdict(), robots=robots, verdict=FAILED, reason=line)


COLUMNS = tuple(Row.model_fields)


def _timings(phases: Phases) -> dict[str, Any]:
    return {
        f"{phase}_cpu_{statistic}_ms": value
        for phase, durations in phases.model_dump().items()
        for statistic, value in durations.items()
    }
