"""What an evaluation leaves behind, run by run, so that it can be interrupted at any time and resumed."""

import csv
import fcntl
import io
import os
from contextlib import suppress
from pathlib import Path
from typing import Self

from pydantic import ValidationError

from chassis.files import write_whole
from fleet.evaluate.evaluation import Evaluation
from fleet.evaluate.row import COLUMNS, Row, RunKey

EXPERIMENT, RUNS = "experiment.json", "runs.csv"


class ResultsError(Exception):
    """A directory that cannot be used for results; the text says why and what to do."""


class Results:
    """The directory of an evaluation while it goes on; a context manager.

    Args:
        directory: made if need be; one that holds runs of the same evaluation is gone on with.
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
            ResultsError: it cannot be used, or belongs to a different evaluation or one that is going on.
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
            raise ResultsError(f"{self.directory} cannot be used for results: {error.strerror}") from None
        try:
            self._resume()
        except BaseException:
            self._file.close()
            raise
        return self

    def __exit__(self, *_error: object) -> None:
        """Close the table; every row of it has been written, or has been complained about."""
        with suppress(OSError):
            self._file.close()

    def add(self, row: Row) -> None:
        """Keep a finished run for good.

        Raises:
            ResultsError: the disk does not take it.
        """
        self._write(row.model_dump().values())
        self.rows[row.key] = row

    def _expect_same_evaluation(self) -> None:
        differences = read_evaluation(self.directory).differences(self._evaluation)
        if differences:
            raise ResultsError(
                f"{self.directory} holds a different evaluation:\n"
                + "\n".join(f"  {difference}" for difference in differences)
                + "\nChoose another directory with --out, or repeat what is there."
            )

    def _resume(self) -> None:
        """Take what is finished and cut off what was not written to its end."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ResultsError(
                f"{self.directory}: another evaluation is writing there; wait for its end, or choose another "
                "directory with --out"
            ) from None
        self._file.seek(0)
        whole = _whole_lines(self._file.read())
        self._file.truncate(len(whole))
        self.rows = {row.key: row for row in _parsed(whole, self.directory / RUNS)}
        if not whole:
            self._write(COLUMNS)

    def _write(self, cells: object) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(cells)  # type: ignore[arg-type]
        try:
            self._file.write(text.getvalue().encode())
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise ResultsError(f"{self.directory / RUNS}: cannot be written: {error.strerror}") from None


def read_evaluation(directory: Path) -> Evaluation:
    """What a directory of results was made from.

    Raises:
        ResultsError: it holds no results, or ones of another version of their format.
    """
    path = directory / EXPERIMENT
    try:
        return Evaluation.model_validate_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultsError(
            f"{directory} holds no evaluation: {EXPERIMENT}: {error.strerror}; name a directory that "
            "`unspoken evaluate` has written, or for a new evaluation an empty one"
        ) from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the whole"
        raise ResultsError(
            f"{path}: not the settings of an evaluation of this version: {where}: {first['msg']}; "
            "name another directory"
        ) from None


def read_rows(directory: Path) -> list[Row]:
    """The finished runs of a directory of results, in the order in which they were finished.

    Raises:
        ResultsError: the table is missing or damaged.
    """
    path = directory / RUNS
    try:
        return _parsed(_whole_lines(path.read_bytes()), path)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be read: {error.strerror}") from None


def _whole_lines(content: bytes) -> bytes:
    """Without a last line that was not written to its end."""
    return content[: content.rfind(b"\n") + 1]


def _parsed(content: bytes, path: Path) -> list[Row]:
    try:
        header, *lines = csv.reader(content.decode().split("\n")[:-1]) if content else [list(COLUMNS)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ResultsError(f"{path}: damaged: {error}; remove the damaged lines") from None
    if tuple(header) != COLUMNS:
        raise ResultsError(
            f"{path}: its columns are not those of this version, {', '.join(COLUMNS)}; name another directory"
        )
    return [_row(cells, f"{path}:{number}") for number, cells in enumerate(lines, 2)]


def _row(cells: list[str], where: str) -> Row:
    try:
        named = zip(COLUMNS, cells, strict=True)
        return Row.model_validate_strings({column: cell for column, cell in named if cell})
    except ValueError as error:
        raise ResultsError(f"{where}: not a row of results: {error}; remove this line") from None
