"""``unspoken bench``: the command line."""

from typing import Annotated

import typer

from fleet.bench.settings import MOST_ROBOTS, SectionName, Settings
from fleet.record.report_file import JsonOption

DEFAULT = Settings()


def _numbers(text: str) -> str:
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not all(2 <= number <= MOST_ROBOTS for number in numbers):
        raise typer.BadParameter(
            f"{text!r} found, whole numbers from 2 to {MOST_ROBOTS} with commas between are expected, "
            "such as 2,8"
        )
    return text


def bench(
    only: Annotated[
        list[SectionName] | None,
        typer.Option(help="Measure this section; may be given several times.", show_default="all"),
    ] = None,
    robots: Annotated[
        str, typer.Option(callback=_numbers, help="Numbers of robots.", metavar="N,N,…")
    ] = ",".join(map(str, DEFAULT.robots)),
    crossings: Annotated[
        int, typer.Option(min=1, help="Random crossings of up to 8 robots; fewer are driven of more robots.")
    ] = DEFAULT.crossings,
    seed: Annotated[int, typer.Option(min=0, help="Of the first random crossing.")] = DEFAULT.seed,
    steps: Annotated[
        int, typer.Option(min=2, help="Of each closed loop of the joint prediction.")
    ] = DEFAULT.steps,
    decisions: Annotated[
        int, typer.Option(min=1, help="A closed loop of whole decisions ends after so many.")
    ] = DEFAULT.decisions,
    rounds: Annotated[int, typer.Option(min=1, help="Over the bus, a number of robots.")] = DEFAULT.rounds,
    starts: Annotated[
        int, typer.Option(min=1, help="Of one agent's process, to readiness.")
    ] = DEFAULT.starts,
    reference: Annotated[
        bool, typer.Option(help="Compare with the reference solver, which takes minutes.")
    ] = DEFAULT.reference,
    json: JsonOption = None,
) -> None:
    """Measure how fast and how good decisions are on this machine: solver, decisions, bus and processes.

    Takes minutes; Ctrl-C ends it with what has been measured so far. docs/performance.md explains it.

    Exit status: 0 everything was measured, whatever the figures; 1 interrupted, the report is marked as
    incomplete; 2 wrong usage; 3 a process failed or the report cannot be written.
    """
    settings = Settings(
        sections=tuple(name for name in SectionName if only is None or name in only),
        robots=tuple(sorted({int(part) for part in robots.split(",")})),
        seed=seed,
        crossings=crossings,
        steps=steps,
        decisions=decisions,
        rounds=rounds,
        starts=starts,
        reference=reference,
    )
    from fleet.bench.conducting import conduct

    raise typer.Exit(conduct(settings, json))
