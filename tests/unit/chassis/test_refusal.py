"""A refusal is printed once, on standard error, and its status is that of the command."""

from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from chassis.refusal import Command, ExitStatus, Group, Refusal, app_of, said_by


def _refuse(value: str) -> str:
    if value == "in an option":
        raise Refusal("an option refuses", ExitStatus.FAILED)
    return value


def work(where: Annotated[str, typer.Option(callback=_refuse)] = "nowhere") -> None:
    """Refuse where it is told to."""
    if where == "inside":
        with said_by("robot 3"):
            raise Refusal("it is missing; make one")
    if where == "unmet":
        raise typer.Exit(ExitStatus.UNMET)


def nested() -> typer.Typer:
    inner = typer.Typer(cls=Group)
    inner.command("work", cls=Command)(work)
    inner.command("rest")(lambda: None)
    outer = typer.Typer(cls=Group)
    outer.add_typer(inner, name="inner")
    return outer


@pytest.mark.parametrize(
    ("where", "line", "status"),
    [
        ("nowhere", "", ExitStatus.DONE),
        ("unmet", "", ExitStatus.UNMET),
        ("inside", "robot 3: it is missing; make one\n", ExitStatus.WRONG_USAGE),
        ("in an option", "an option refuses\n", ExitStatus.FAILED),
    ],
)
@pytest.mark.parametrize(("app", "words"), [(app_of(work), []), (nested(), ["inner", "work"])])
def test_a_lone_command_and_one_in_groups_refuse_once(
    app: typer.Typer, words: list[str], where: str, line: str, status: ExitStatus
) -> None:
    result = CliRunner().invoke(app, [*words, "--where", where])
    assert (result.stdout, result.stderr, result.exit_code) == ("", line, status)
