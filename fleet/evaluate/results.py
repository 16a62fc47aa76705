"""The results of an evaluation: a row of ``runs.csv`` for each run, kept at once, to be resumed."""

import csv
import fcntl
import io
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, BinaryIO, Self

from pydantic import Field, ValidationError

from agent.estimate import GoalsName
from agent.solve import SolverName
from chassis.files import Record, write_whole
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.evaluation import Evaluation, NoiseLevel, Run, RunKey
from fleet.record.summary import Summary

EXPERIMENT, RUNS = "experiment.json", "runs.csv"
FAILED = "failed"
"""The verdict of a run that ended with an exception."""
DIED = "the worker process died each time that this was tried"
"""The reason of a run that took its process along."""
_LONGEST_REASON = 500

Line = Annotated[str, Field(pattern=r"^[^\r\n]*$")]
"""Text without a line break: a row is one line of the file."""


class Row(Record):
    """One finished run. Its fields are the columns of ``runs.csv``, in this order; an empty cell is None.

    A run that failed has nothing but its key, the number of robots, the verdict and the reason.
    """

    scenario: Line
    """The stem of its file."""
    robots: int
    method: GoalsName
    """How the robots come to know goals."""
    solver: SolverName
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
    interventions: int | None = None
    """How often the reserve or the last resort has begun to hold a robot back, over all robots."""
    side_disagreement: float | None = None
    """Share of the next in which two robots predict to pass on different sides; None where it is zero."""
    side_pair_steps: int | None = None
    closest_to_collision: float | None = None
    """Smallest distance of two robots over that at which they collide; None with a single robot too."""
    closest_to_safety: float | None = None
    """The same over their safety distance."""

    @property
    def key(self) -> RunKey:
        """Which run it is."""
        return RunKey(self.scenario, self.method, self.solver, self.noise, self.seed)

    @property
    def failed(self) -> bool:
        """Whether the run ended with an exception."""
        return self.verdict == FAILED

    @classmethod
    def finished(cls, run: Run, summary: Summary, cpu_s: float, wall_s: float) -> Self:
        """The row of a run that has come to a verdict, with the CPU and the wall-clock time that it took.

        The decisions in its summary were timed with the thread's CPU clock.
        """
        arrivals_s = [robot.arrived_s for robot in summary.robots if robot.arrived_s is not None]
        robots = len(summary.robots)
        driven_m = sum(robot.driven_m for robot in summary.robots)
        same = "verdict duration_s minimum_distance_m collisions steps solver_failures clipped_commands"
        same += " interventions side_disagreement side_pair_steps"
        distances = summary.relative_distances
        return cls(
            **run.key._asdict(),
            **{name: getattr(summary, name) for name in same.split()},
            **{
                f"{phase}_cpu_{statistic}_ms": value
                for phase, durations in summary.phases_ms
                for statistic, value in durations
            },
            robots=robots,
            arrived=len(arrivals_s),
            robot_duration_mean_s=sum(arrivals_s) / robots if len(arrivals_s) == robots else None,
            driven_m=driven_m,
            closest_to_collision=None if distances is None else distances.to_collision.min,
            closest_to_safety=None if distances is None else distances.to_safety.min,
            robot_driven_mean_m=driven_m / robots,
            cpu_s=cpu_s,
            wall_s=wall_s,
        )

    @classmethod
    def without_result(cls, run: Run, reason: str) -> Self:
        """The row of a run that failed, for a reason that is put on one line."""
        line = " ".join(reason.split())[:_LONGEST_REASON]
        robots = len(run.scenario.robots)
        return cls(**run.key._asdict(), robots=robots, verdict=FAILED, reason=line)


COLUMNS = tuple(Row.model_fields)


class Results:
    """The table of an evaluation that goes on: the finished runs by key, and where more are kept.

    What was not written to its end is cut off.

    Args:
        path: for people.
        file: to read and append.

    Raises:
        Refusal: the table is damaged, or the disk does not take it.
    """

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path, self._file = path, file
        file.seek(0)
        whole = _whole_lines(file.read())
        file.truncate(len(whole))
        self.rows: dict[RunKey, Row] = {row.key: row for row in _parsed(whole, path)}
        if not whole:
            self._write(COLUMNS)

    def add(self, row: Row) -> None:
        """Keep a finished run for good.

        Raises:
            Refusal: the disk does not take it.
        """
        self._write(row.model_dump().values())
        self.rows[row.key] = row

    def _write(self, cells: Iterable[object]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(cells)
        try:
            self._file.write(text.getvalue().encode())
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise Refusal(f"{self._path}: cannot be written: {error.strerror}", ExitStatus.FAILED) from None


@contextmanager
def open_results(directory: Path, evaluation: Evaluation) -> Iterator[Results]:
    """The results in a directory, which is made if need be; one with runs of this evaluation is resumed.

    Raises:
        Refusal: it cannot be used, or belongs to a different evaluation or one that is going on.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if not any(directory.iterdir()):
            write_whole(directory / EXPERIMENT, evaluation.model_dump_json(by_alias=True, indent=2) + "\n")
        elif differences := read_evaluation(directory).differences(evaluation):
            raise Refusal(
                f"{directory} holds a different evaluation:\n"
                + "\n".join(f"  {difference}" for difference in differences)
                + "\nChoose another directory with --out, or repeat what is there."
            )
        file = (directory / RUNS).open("a+b")
    except OSError as error:
        raise Refusal(f"{directory} cannot be used for results: {error.strerror}") from None
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise Refusal(
                f"{directory}: another evaluation is writing there; wait for its end, or choose another "
                "directory with --out"
            ) from None
        yield Results(directory / RUNS, file)
    finally:
        with suppress(OSError):  # every row is on the disk already, or was refused
            file.close()


def read_evaluation(directory: Path) -> Evaluation:
    """What a directory of results was made from.

    Raises:
        Refusal: it holds no results, or ones of another version of their format.
    """
    path = directory / EXPERIMENT
    try:
        return Evaluation.model_validate_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise Refusal(
            f"{directory} holds no evaluation: {EXPERIMENT}: {error.strerror}; name a directory that "
            "`unspoken evaluate` has written, or for a new evaluation an empty one"
        ) from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the whole"
        raise Refusal(
            f"{path}: not the settings of an evaluation of this version: {where}: {first['msg']}; "
            "name another directory"
        ) from None


def read_rows(directory: Path) -> list[Row]:
    """The finished runs of a directory of results, in the order in which they were finished.

    Raises:
        Refusal: the table is missing or damaged.
    """
    path = directory / RUNS
    try:
        return _parsed(_whole_lines(path.read_bytes()), path)
    except OSError as error:
        raise Refusal(f"{path}: cannot be read: {error.strerror}") from None


def _whole_lines(content: bytes) -> bytes:
    """Without a last line that was not written to its end."""
    return content[: content.rfind(b"\n") + 1]


def _parsed(content: bytes, path: Path) -> list[Row]:
    try:
        header, *lines = csv.reader(content.decode().split("\n")[:-1]) if content else [list(COLUMNS)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise Refusal(f"{path}: damaged: {error}; remove the damaged lines") from None
    if tuple(header) != COLUMNS:
        raise Refusal(
            f"{path}: its columns are not those of this version, {', '.join(COLUMNS)}; name another directory"
        )
    return [_row(cells, f"{path}:{number}") for number, cells in enumerate(lines, 2)]


def _row(cells: list[str], where: str) -> Row:
    try:
        named = zip(COLUMNS, cells, strict=True)
        return Row.model_validate_strings({column: cell for column, cell in named if cell})
    except ValueError as error:
        raise Refusal(f"{where}: not a row of results: {error}; remove this line") from None
