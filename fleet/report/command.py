"""``unspoken report``: the command line."""

from pathlib import Path
from typing import Annotated

import typer

WORST = 4


def report(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="A directory that unspoken evaluate has written.")
    ],
    against: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The method with which the others are compared, scenario by scenario.",
            show_default="exchanged, or else the first",
        ),
    ] = None,
    worst: Annotated[
        int, typer.Option(min=0, help="How many of the worst runs are driven again and shown.")
    ] = WORST,
) -> None:
    """Make a page of an evaluation: report.html in its directory, and its figures as PNG files beside it.

    It shows box plots beside the publication's medians, tables with confidence intervals, and the worst runs.
    An evaluation that is not finished is reported as far as it is. The page needs no network and no scripts.

    Exit status: 0 written; 1 interrupted, nothing written; 2 wrong usage, or there is nothing to report;
    3 the solver cannot be compiled.
    """
    from fleet.report.conducting import conduct  # SciPy takes long to import

    raise typer.Exit(conduct(directory, against, worst))
