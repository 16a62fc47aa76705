"""How a command says no: one sentence for people on standard error, and one exit status with a name."""

from enum import IntEnum
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup


class ExitStatus(IntEnum):
    """What the exit status of every command means; the help text of a command says what that is for it."""

    DONE = 0
    """It did what was asked, and it came out as hoped."""
    UNMET = 1
    """It ended in order, but not as hoped: not all robots arrived, a device is not ready, an interruption."""
    WRONG_USAGE = 2
    """What it was given is wrong: options, files, keys."""
    FAILED = 3
    """Something that it needs failed or is not there: a process, the network, the disk, the world."""


class Refusal(Exception):
    """The end of a command before it has done its work.

    Raised wherever the reason is found, and printed in one place, :class:`Refusing`.

    Args:
        sentence: what was found, where, what was expected and what to do.
        status: with which the command ends.
    """

    def __init__(self, sentence: str, status: ExitStatus = ExitStatus.WRONG_USAGE) -> None:
        super().__init__(sentence)
        self.status = status


class Refusing:
    """Of a command line: ends with the sentence and the status of a refusal."""

    def invoke(self, ctx: Any) -> Any:  # typer keeps the type of its context to itself
        """Run the command."""
        try:
            return super().invoke(ctx)  # type: ignore[misc]
        except Refusal as refusal:
            typer.echo(str(refusal), err=True)
            raise typer.Exit(refusal.status) from None


class Command(Refusing, TyperCommand):
    """A command that may refuse: ``@app.command(cls=Command)`` where it stands alone."""


class Group(Refusing, TyperGroup):
    """A group of commands that may refuse: ``typer.Typer(cls=Group)``."""
