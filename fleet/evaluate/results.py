"""The results of an evaluation: a row of ``runs.csv`` for each run, kept at once, to be resumed."""

import csv
import fcntl
import io
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, ValidationError

from chassis.files import write_whole
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.evaluation import Evaluation, NoiseLevel, RunKey
from fleet.record.report_file import Record
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
        driven_m = sum(robot.driven_m for robot in summary.robots)
        timings_ms = {
            f"{phase}_cpu_{statistic}_ms": value
            for phase, durations in summary.phases_ms.model_dump().items()
            for statistic, value in durations.items()
        }
        same = "verdict duration_s minimum_distance_m collisions steps solver_failures clipped_commands"
        return cls(
            **key._asdict(),
            **{name: getattr(summary, name) for name in same.split()},
            robots=robots,
            arrived=len(arrivals_s),
            robot_duration_mean_s=sum(arrivals_s) / robots if len(arrivals_s) == robots else None,
            driven_m=driven_m,
            robot_driven_mean_m=driven_m / robots,
            cpu_s=cpu_s,
            wall_s=wall_s,
            **timings_ms,
        )

    @classmethod
    def without_result(cls, key: RunKey, robots: int, reason: str) -> Self:
        """The row of a run that failed, for a reason that is put on one line."""
        line = " ".join(reason.split())[:_LONGEST_REASON]
        return cls(**key._asdict(), robots=robots, verdict=FAILED, reason=line)


COLUMNS = tuple(Row.model_fields)


class Results:
    """The directory of an evaluation while it goes on; a context manager.

    Args:
        directory: made if need be; one that holds runs of the same evaluation is resumed.
        evaluation: what is evaluated.

    Attributes:
        rows: the runs that are finished, by key.
    """

    def __init__(self, directory: Path, evaluation: Evaluation) -> None:
        self.directory = directory
        self._evaluation = evaluation
        self.rows: dict[RunKey, Row] = {}

    def __enter__(self) -> Self:
        """Make the directory or read what is in it.

        Raises:
            Refusal: it cannot be used, or belongs to a different evaluation or one that is going on.
        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            if any(self.directory.iterdir()):
                self._expect_same_evaluation()
            else:
                text = self._evaluation.model_dump_json(by_alias=True, indent=2)
                write_whole(self.directory / EXPERIMENT, text + "\n")
            self._file = (self.directory / RUNS).open("a+b")
        except OSError as error:
            raise Refusal(f"{self.directory} cannot be used for results: {error.strerror}") from None
        try:
            self._resume()
        except BaseException:
            self._file.close()
            raise
        return self

    def __exit__(self, *_error: object) -> None:
        """Close the table; every row of it is on the disk already, or was refused."""
        with suppress(OSError):
            self._file.close()

    def add(self, row: Row) -> None:
        """Keep a finished run for good.

        Raises:
            Refusal: the disk does not take it.
        """
        self._write(row.model_dump().values())
        self.rows[row.key] = row

    def _expect_same_evaluation(self) -> None:
        differences = read_evaluation(self.directory).differences(self._evaluation)
        if differences:
            raise Refusal(
                f"{self.directory} holds a different evaluation:\n"
                + "\n".join(f"  {difference}" for difference in differences)
                + "\nChoose another directory with --out, or repeat what is there."
            )

    def _resume(self) -> None:
        """Take what is finished and cut off what was not written to its end."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise Refusal(
                f"{self.directory}: another evaluation is writing there; wait for its end, or choose another "
                "directory with --out"
            ) from None
        self._file.seek(0)
        whole = _whole_lines(self._file.read())
        self._file.truncate(len(whole))
        self.rows = {row.key: row for row in _parsed(whole, self.directory / RUNS)}
        if not whole:
            self._write(COLUMNS)

    def _write(self, cells: Iterable[object]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(cells)
        try:
            self._file.write(text.getvalue().encode())
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            sentence = f"{self.directory / RUNS}: cannot be written: {error.strerror}"
            raise Refusal(sentence, ExitStatus.FAILED) from None


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
