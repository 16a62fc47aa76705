"""How a command says no: one sentence for people on standard error, and one exit status with a name."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
    """What it got is wrong: options, files, keys."""
    FAILED = 3
    """Something that it needs failed or is not there: a process, the network, the disk, the world."""


class Refusal(Exception):
    """The end of a command before it has done its work.

    Raised wherever the reason is found, and printed in one place, :class:`Command` or :class:`Group`.
    """

    def __init__(self, sentence: str, status: ExitStatus = ExitStatus.WRONG_USAGE) -> None:
        super().__init__(sentence)
        self.status = status


@contextmanager
def said_by(name: str) -> Iterator[None]:
    """Put the name of a process in front of the sentences of refusals, where several share a terminal."""
    try:
        yield
    except Refusal as refusal:
        raise Refusal(f"{name}: {refusal}", refusal.status) from refusal


@contextmanager
def _printed() -> Iterator[None]:
    try:
        yield
    except Refusal as refusal:
        typer.echo(str(refusal), err=True)
        raise typer.Exit(refusal.status) from None


class Refusing:
    """Of a command line: ends with the sentence and the status of a refusal."""

    def make_context(self, *args: Any, **settings: Any) -> Any:
        """Read the arguments; a callback of an option may refuse."""
        with _printed():
            return super().make_context(*args, **settings)  # type: ignore[misc]

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with _printed():
            return super().invoke(ctx)  # type: ignore[misc]


class Command(Refusing, TyperCommand):
    """A command that may refuse: ``@app.command(cls=Command)`` where it stands alone."""


class Group(Refusing, TyperGroup):
    """A group of commands that may refuse: ``typer.Typer(cls=Group)``."""


LOOK: dict[str, Any] = {"max_content_width": 100}
"""Of help texts, which are plain text: they wrap at any width, and their lines can be searched."""


def app_of(command: Callable[..., None]) -> typer.Typer:
    """The command line of a function that may refuse."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command(cls=Command, context_settings=LOOK)(command)
    return app


def run(command: Callable[..., None]) -> None:
    """Like ``typer.run``, with a command that may refuse."""
    app_of(command)()
