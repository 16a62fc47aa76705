"""Options that every command line has by which robots are let in."""

from pathlib import Path
from typing import Annotated

import typer

from chassis.healthy import HELP as WATCH_PORT_HELP
from chassis.healthy import VARIABLE as WATCH_PORT
from protocol.keys import NAME_RULE, checked_name

LONGEST_WAIT_S = 86_400.0


def _run_name(value: str) -> str:
    try:
        return checked_name(value)
    except ValueError:
        raise typer.BadParameter(f"{value!r} is no name of a run: {NAME_RULE}") from None


def seconds(value: float) -> float:
    """A time that somebody can wait.

    Raises:
        typer.BadParameter: it is negative, too long or no number.
    """
    if not 0.0 <= value <= LONGEST_WAIT_S:  # also refuses NaN
        raise typer.BadParameter(f"{value} found, 0 to {LONGEST_WAIT_S:g} seconds are expected")
    return value


ListenOption = Annotated[
    str, typer.Option(envvar="UNSPOKEN_LISTEN", help="Zenoh endpoint at which robots connect.")
]
UsersOption = Annotated[
    Path | None,
    typer.Option(
        envvar="UNSPOKEN_USERS",
        help="File of lines name:password, for every robot and @bench, which only you can read. With it, "
        "each may do what the policy grants it and nothing else.",
        show_default="none, and whoever connects may read and say anything",
    ),
]
KeysOption = Annotated[
    Path | None,
    typer.Option(
        envvar="UNSPOKEN_KEYS",
        help="Folder with the world's keys, as 'unspoken keys' makes it, for an endpoint tls/…; instead "
        "of passwords.",
        show_default="none",
    ),
]
InsecureOption = Annotated[
    bool,
    typer.Option(
        "--insecure",
        envvar="UNSPOKEN_INSECURE",
        help="Let other machines connect although nothing is encrypted.",
    ),
]
RunOption = Annotated[
    str,
    typer.Option(
        envvar="UNSPOKEN_RUN", callback=_run_name, help="Name of the run, first part of all its keys."
    ),
]
StartTimeoutOption = Annotated[
    float,
    typer.Option(
        envvar="UNSPOKEN_START_TIMEOUT",
        callback=seconds,
        help="Seconds to wait for all robots at the start.",
    ),
]
WatchPortOption = Annotated[
    int | None,
    typer.Option(envvar=WATCH_PORT, min=0, max=65535, help=WATCH_PORT_HELP, show_default="none"),
]
