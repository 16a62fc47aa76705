"""Reports as JSON: the base of their records, and where they are written."""

import sys
from pathlib import Path
from typing import Annotated, Final

import typer
from pydantic import BaseModel, ConfigDict
from rich.console import Console

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


def write_report(text: str, path: Path, errors: Console) -> bool:
    """Write a report and tell why where that is not possible.

    Args:
        text: the report.
        path: where to; ``-`` is the standard output.
        errors: for people.

    Returns:
        Whether it could be written.
    """
    if path == TO_STDOUT:
        sys.stdout.write(text + "\n")
        return True
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        errors.print(
            f"unspoken: {path}: the report cannot be written there: {error.strerror}; "
            "a file in a directory that exists and can be written is expected in --json",
            markup=False,
            soft_wrap=True,
        )
        return False
    return True
