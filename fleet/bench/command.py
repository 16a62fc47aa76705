"""``unspoken bench``: its command line, what it shows meanwhile, and where its report goes."""

from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress as Bar
from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

from chassis.refusal import ExitStatus, Refusal
from fleet.bench.measuring import MOST_ROBOTS, Progress, SectionName, Settings
from fleet.bench.report import Bench
from fleet.interruption import Interruption
from fleet.record.report import TO_STDOUT, JsonOption, write_report

DEFAULT = Settings()
WIDTH = 120
"""What the widest table needs."""


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
        str, typer.Option(callback=_numbers, help="Numbers of robots to measure with.", metavar="N,N,…")
    ] = ",".join(map(str, DEFAULT.robots)),
    crossings: Annotated[
        int, typer.Option(min=1, help="Random crossings for each number up to 8; fewer for more robots.")
    ] = DEFAULT.crossings,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first random crossing.")] = DEFAULT.seed,
    steps: Annotated[
        int, typer.Option(min=2, help="Steps of each closed loop of the joint prediction.")
    ] = DEFAULT.steps,
    decisions: Annotated[
        int, typer.Option(min=1, help="Decisions after which a closed loop of whole decisions ends.")
    ] = DEFAULT.decisions,
    rounds: Annotated[
        int, typer.Option(min=1, help="Rounds over the bus for each number of robots.")
    ] = DEFAULT.rounds,
    starts: Annotated[
        int, typer.Option(min=1, help="Starts of a single agent's process, up to its readiness.")
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
    measuring = Bench(settings)
    if json not in (None, TO_STDOUT):  # a mistake in the path is told now, not after minutes
        write_report(measuring.report().to_json(), json, ExitStatus.WRONG_USAGE)
    failure = _measure(measuring)
    report = measuring.report()
    report.show(_console(stderr=json == TO_STDOUT))
    if json is not None:
        write_report(report.to_json(), json)
    if isinstance(failure, Refusal):
        raise failure
    if failure is not None:
        raise typer.Exit(ExitStatus.UNMET)


def _measure(measuring: Bench) -> KeyboardInterrupt | Refusal | None:
    """Measure as far as possible; what prevented the rest."""
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Interruption() as interruption, Bar(*columns, console=_console(stderr=True), transient=True) as bar:
        line = bar.add_task("", total=None)
        try:
            measuring.measure(Progress(interruption, lambda work: bar.update(line, description=work)))
        except (KeyboardInterrupt, Refusal) as failure:
            return failure
    return None


def _console(*, stderr: bool) -> Console:
    """One whose tables are never cut: on a narrow terminal their lines go on in the next one."""
    width = max(Console(stderr=stderr).width, WIDTH)
    return Console(stderr=stderr, highlight=False, width=width)
