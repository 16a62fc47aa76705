"""``unspoken hunt``: searches for the scenarios that hurt most, shows and keeps them."""

import math
from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import product
from pathlib import Path
from typing import Annotated, Literal, get_args

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from agent.estimate import DEFAULT_GOALS, GoalsName
from agent.process.options import DecisionOptions
from chassis.options import option
from chassis.refusal import ExitStatus, Refusal
from fleet.hunt.attempt import ENOUGH, Attempt, Harm, Outcome, Points, attempt
from fleet.hunt.finds import Find, Finds, Results, Settings
from fleet.interruption import Interruption, announced, compile_solver
from fleet.record.report import CORES, new_table, number, progress_of_many, this_machine
from fleet.scenarios.command import checked_numbers, numbers_in
from fleet.scenarios.wild import WildName, coordinates

HARMS: tuple[Harm, ...] = get_args(Harm)
TITLES: dict[str, str] = {
    "distance": "Smallest distances",
    "deadlock": "Robots that did not get on",
    "time": "Slowest crossings",
    "failed": "Runs that ended with an exception",
}


def hunt(
    runs: Annotated[int, typer.Option(min=1, help="Number of runs, shared out among all searches.")] = 500,
    robots: Annotated[
        str,
        typer.Option(
            callback=checked_numbers,
            metavar="N,N..N",
            help="Numbers of robots, 2 to 8; each has a search of its own.",
        ),
    ] = "2..3",
    harm: Annotated[
        Literal["distance", "deadlock", "time", "all"],
        typer.Option(
            "--for",
            help="What to look for: the smallest distance relative to contact, robots that never arrive or "
            "stand for long, the slowest crossing relative to each robot driving alone, or all in turn.",
        ),
    ] = "all",
    family: Annotated[
        WildName, typer.Option(help="Space of scenarios; wild-noisy includes noise, dropouts and delay.")
    ] = "wild",
    goals: Annotated[GoalsName, option(DecisionOptions, "goals")] = DEFAULT_GOALS,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search and of sensor noise.")] = 0,
    keep: Annotated[int, typer.Option(min=1, help="Number of scenarios of each kind to keep.")] = 5,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Number of worker processes.", show_default="one per core"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for what is found, new or empty.",
            metavar="DIR",
            show_default="runs/hunt-<time>",
            file_okay=False,
        ),
    ] = None,
) -> None:
    """Search the scenarios of the family wild for those that hurt most, in virtual time.

    An optimiser (CMA-ES) changes bodies, limits, ways, horizons and weights until robots come near, do not
    arrive, or take long; then it begins elsewhere. The worst scenarios are printed with the commands that
    repeat them, and written as files with a results.json. Ctrl-C ends the hunt and keeps what was found. The
    same options find the same scenarios. docs/hunt.md explains the search and the results.

    Exit status: 0 in every run all robots arrived without contact, 1 they did not, or interrupted, 2 invalid
    usage, 3 a run failed with an exception, or the runs could not be made.
    """
    settings = Settings(
        family=family,
        robots=tuple(dict.fromkeys(numbers_in(robots))),
        harms=HARMS if harm == "all" else (harm,),
        goals=goals,
        seed=seed,
        runs=runs,
        keep=keep,
    )
    for each in settings.robots:
        coordinates(each)  # refuses numbers of robots that the family has no scenarios for
    begun = datetime.now().astimezone().replace(microsecond=0)
    finds = Finds(out or Path("runs") / f"hunt-{begun:%Y%m%d-%H%M%S}", settings, this_machine(), begun)
    complaint: Refusal | None = None
    try:
        _hunted(settings, workers or CORES, finds)
    except KeyboardInterrupt:
        pass  # said below
    except Refusal as refusal:  # what was found before is kept first
        complaint = refusal
    results = finds.write()
    _show(results, finds.directory)
    if complaint is not None:
        raise complaint
    if results.made < runs:
        raise Refusal(f"Interrupted: {results.made} of {runs} runs were made", ExitStatus.UNMET)
    if results.failed:
        raise typer.Exit(ExitStatus.FAILED)
    if results.contacts or results.not_arrived:
        raise typer.Exit(ExitStatus.UNMET)


def _hunted(settings: Settings, workers: int, finds: Finds) -> None:
    """Make all searches, one after the other, and show how far they are.

    Raises:
        KeyboardInterrupt: interrupted.
        Refusal: the runs cannot be made, or the finds not be kept.
    """
    from fleet.evaluate.running import local_cluster, outcomes  # takes long
    from fleet.hunt.search import Search  # the same

    errors = Console(stderr=True, highlight=False)
    with Interruption() as interruption, progress_of_many(errors) as progress:
        line = progress.add_task(announced("starting"), total=None, failed="")
        compile_solver(interruption)
        progress.update(line, total=settings.runs)
        with local_cluster(min(workers, settings.runs)) as client:

            def values_of(points: Points) -> list[float]:
                tried = finds.attempts(points, harm, robots, search.start)
                values = {each.number: math.inf for each in tried}
                for outcome in outcomes(client, tried, attempt, Attempt.without_result, interruption):
                    finds.add(outcome)
                    values[outcome.number] = outcome.value(harm)
                    told = "" if (worst := finds.worst(harm)) is None else f"worst {_figure(harm, worst)}"
                    progress.update(line, advance=1, description=f"{harm}, {robots} robots", failed=told)
                finds.write()
                return list(values.values())

            for harm, robots, budget in _budgets(settings):
                random = np.random.default_rng((settings.seed, HARMS.index(harm), robots))
                size = coordinates(robots, noisy=settings.family == "wild-noisy")
                search = Search(size, random, ENOUGH[harm])
                search.run(budget, values_of)


def _budgets(settings: Settings) -> Iterator[tuple[Harm, int, int]]:
    """What is looked for among how many robots, with how many runs: equal shares of all."""
    searches = list(product(settings.harms, settings.robots))
    ends = [settings.runs * index // len(searches) for index in range(len(searches) + 1)]
    for (harm, robots), begin, end in zip(searches, ends, ends[1:], strict=False):
        yield harm, robots, end - begin


def _figure(harm: Harm, outcome: Outcome) -> str:
    """What is looked for, in a few words."""
    if harm == "distance":
        return f"{number(outcome.closest)} × contact"
    if harm == "time":
        return f"{number(outcome.slowdown)} × alone"
    return (
        f"{outcome.missing} never arrived" if outcome.missing else f"stood {number(outcome.standstill_s)} s"
    )


def _show(results: Results, directory: Path) -> None:
    """Tables of what hurts most, the commands that repeat it, and how much was tried."""
    console = Console(highlight=False)
    for harm in dict.fromkeys(find.harm for find in results.finds):
        finds = [find for find in results.finds if find.harm == harm]
        console.print(_table(TITLES[harm], finds))
        for find in finds:
            lines = [find.command, *([find.outcome.reason] if find.outcome.reason else []), *find.warnings]
            console.print("\n  ".join(lines), markup=False, soft_wrap=True)
        console.print()
    console.print(
        f"{results.made} runs: contact in {results.contacts}, not all arrived in {results.not_arrived}, "
        f"exceptions in {results.failed}. Kept in {directory}: "
        f"{', '.join(sorted(path.name for path in directory.iterdir()))}",
        markup=False,
        soft_wrap=True,
    )


def _table(title: str, finds: Sequence[Find]) -> Table:
    """One line a scenario."""
    headers = "File|Verdict|Robots|Closest,\n× contact|Never\narrived|Stood\nin s|× time\nalone"
    table = new_table(title, *headers.split("|"), names=2)
    for find in finds:
        outcome = find.outcome
        table.add_row(
            find.file,
            outcome.verdict,
            str(find.robots),
            number(outcome.closest),
            str(outcome.missing),
            number(outcome.standstill_s),
            number(outcome.slowdown),
        )
    return table
