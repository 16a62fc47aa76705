"""The command line ``unspoken`` of a device: this robot, and nothing of the bench."""

from typing import Annotated

import typer

import agent.__main__
from chassis.refusal import Group
from protocol.version import version_text

app = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="One mobile robot that crosses others' ways without communicating. 'unspoken agent' is that robot; "
    "the world and the bench come with the whole of Unspoken.",
)
app.command("agent")(agent.__main__.main)


def _tell_version(wanted: bool) -> None:
    if wanted:
        typer.echo(version_text())
        raise typer.Exit


VersionOption = Annotated[
    bool,
    typer.Option("--version", callback=_tell_version, is_eager=True, help="Tell the version and exit."),
]


@app.callback()
def _options(_version: VersionOption = False) -> None:
    """Options of the command itself."""
