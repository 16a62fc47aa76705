"""Reports as JSON: the base of their records, and where they are written."""

import sys
from pathlib import Path
from typing import Annotated, Final

import typer
from pydantic import BaseModel, ConfigDict

from chassis.refusal import ExitStatus, Refusal

TO_STDOUT: Final = Path("-")

JsonOption = Annotated[
    Path | None,
    typer.Option(
        help="Write the report to this file as JSON; - writes it to the standard output and the tables "
        "to the standard error.",
        dir_okay=False,
        allow_dash=True,
    ),
]


class Record(BaseModel):
    """Base of everything in a report: no unknown fields, only finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True)


def write_report(text: str, path: Path, status: ExitStatus = ExitStatus.FAILED) -> None:
    """Write a report into a file, or to the standard output where the path is ``-``.

    Args:
        text: the report.
        path: where to.
        status: of the refusal.

    Raises:
        Refusal: it cannot be written there.
    """
    if path == TO_STDOUT:
        sys.stdout.write(text + "\n")
        return
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise Refusal(
            f"{path}: the report cannot be written there: {error.strerror}; "
            "a file in a directory that exists and can be written is expected in --json",
            status,
        ) from None
