"""``unspoken scenarios``: the command line."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from fleet.inject.scenario import Scenario
from fleet.record.report import new_table
from fleet.scenarios.suite import FAMILIES, FamilyName, load_suite, write_suite
from fleet.scenarios.suite import generate as generated
from protocol.scene import MAX_ROBOTS
from scenarios import bundled_scenarios, bundled_suites

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="List the bundled scenarios and suites, or generate a suite.\n\n"
    "Exit status: 0 done, 2 invalid usage.",
)


@app.command("list")
def list_bundled() -> None:
    """List the bundled scenarios and suites.

    Their names can be used wherever a file or directory is expected.

    Exit status: 0 listed, 2 invalid usage.
    """
    table = new_table("", "Name", "Scenarios", "Robots")
    for name in (*bundled_scenarios(), *bundled_suites()):
        scenarios = load_suite(name).scenarios
        table.add_row(name, str(len(scenarios)), _robots(scenarios.values()))
    Console(highlight=False).print(table)


def numbers_in(text: str) -> list[int]:
    """The numbers of robots that a text such as ``2..4,8`` names.

    Raises:
        typer.BadParameter: it names none.
    """
    numbers: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"(\d{1,3})(?:\.\.(\d{1,3}))?", part, re.ASCII)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        if not 1 <= first <= last <= MAX_ROBOTS:
            raise typer.BadParameter(
                f"{text!r} found, numbers of robots from 1 to {MAX_ROBOTS} are expected, such as 4, 2,4,8 or "
                "2..8"
            )
        numbers.extend(range(first, last + 1))
    return numbers


def checked_numbers(text: str) -> str:
    """A text that ``numbers_in`` understands; for options."""
    numbers_in(text)
    return text


@app.command()
def generate(
    out: Annotated[Path, typer.Option(help="Directory for the suite, new or empty.", file_okay=False)],
    family: Annotated[
        FamilyName,
        typer.Option(metavar="NAME", help=f"Arrangement of starts and goals: {', '.join(FAMILIES)}."),
    ] = "perimeter",
    robots: Annotated[
        str,
        typer.Option(
            callback=checked_numbers,
            help="Numbers of robots; scenarios cycle through them.",
            metavar="N,N..N",
        ),
    ] = "2..8",
    count: Annotated[int, typer.Option(min=1, help="Number of scenarios.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Random seed.")] = 0,
) -> None:
    """Generate a suite: a directory of scenario files; the same options give the same suite.

    Exit status: 0 written, 2 invalid usage, or the directory cannot be used; then nothing is left in it.
    """
    recipe = f"unspoken scenarios generate --family {family} --robots {robots} --count {count} --seed {seed}"
    scenarios = generated(family, numbers_in(robots), count, seed)
    write_suite(out, scenarios, f"Made by {recipe}")
    noun = "scenario" if count == 1 else "scenarios"
    typer.echo(f"Wrote {count} {noun} of {_robots(scenarios.values())} robots to {out}.")


def _robots(scenarios: Iterable[Scenario]) -> str:
    """The least and the largest number of robots."""
    numbers = {len(scenario.robots) for scenario in scenarios}
    return "–".join(str(number) for number in sorted({min(numbers), max(numbers)}))
