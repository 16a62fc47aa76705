"""``unspoken faults``: the command line."""

from pathlib import Path
from typing import Annotated

import typer

from agent.estimate import DEFAULT_GOALS, GoalsName
from agent.process.options import DecisionOptions
from chassis.options import option
from fleet.evaluate.command import CORES
from fleet.faults.cases import BUNDLED, Case, load_cases
from fleet.faults.trial import Trial
from fleet.record.report_file import JsonOption
from fleet.scenarios.command import checked_numbers, numbers_in
from protocol.faults import unknown_robot


def faults(
    suite: Annotated[
        Path | None,
        typer.Argument(
            metavar="SUITE",
            help="A file of cases: faults, and what has to hold.",
            show_default="the bundled one, with every kind",
        ),
    ] = None,
    robots: Annotated[
        str,
        typer.Option(callback=checked_numbers, help="Numbers of robots, each is tried.", metavar="N,N..N"),
    ] = "2,4,8",
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds: each is another crossing.")] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="The first of them.")] = 0,
    only: Annotated[
        list[str] | None, typer.Option(metavar="CASE", help="Try this case only; may be given repeatedly.")
    ] = None,
    goals: Annotated[GoalsName, option(DecisionOptions, "goals")] = DEFAULT_GOALS,
    processes: Annotated[
        bool, typer.Option("--processes", help="In real processes, one trial after the other.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes that simulate.", show_default="one a core"),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Let things break in many crossings, and check what has to hold: in virtual time, or in real processes.

    In every trial no healthy robot may be in a collision that it could have avoided by braking, all healthy
    robots must arrive, nothing may be amiss before the fault, and nothing may be lost from the recording. A
    trial in which something does not hold is told with the command that repeats it. docs/faults.md explains
    the cases.

    Exit status: 0 everything held, 1 something did not, or interrupted, 2 wrong usage, 3 the trials could not
    be made.
    """
    path = suite or BUNDLED
    cases = _chosen(load_cases(path), only, path)
    if not processes:
        cases = [case for case in cases if not case.needs_processes]
    if not cases:
        raise typer.BadParameter("in virtual time these cases mean nothing; give --processes")
    _check_robots(cases, min(numbers_in(robots)), path)
    trials = [
        Trial(case, number, seed, goals)
        for case in cases
        for number in numbers_in(robots)
        for seed in range(first_seed, first_seed + seeds)
    ]
    from fleet.faults.conducting import conduct  # Dask takes long to import

    command = " ".join(
        ["unspoken faults", *([str(suite)] if suite else []), f"--goals {goals}"]
        + (["--processes"] if processes else [])
    )
    raise typer.Exit(conduct(trials, workers or CORES, processes=processes, command=command, json_path=json))


def _check_robots(cases: list[Case], fewest: int, path: Path) -> None:
    """Refuse cases that name robots which a trial would lack: they would break nothing."""
    for case in cases:
        if found := unknown_robot(case.faults, [str(index + 1) for index in range(fewest)]):
            raise typer.BadParameter(
                f"case {case.name!r} of {path}, {found[0]}: {found[1]}; give larger numbers",
                param_hint="--robots",
            )


def _chosen(cases: tuple[Case, ...], only: list[str] | None, path: Path) -> list[Case]:
    names = [case.name for case in cases]
    unknown = [name for name in only or () if name not in names]
    if unknown:
        raise typer.BadParameter(
            f"{unknown[0]!r} found, one of the cases of {path} is expected: {', '.join(names)}",
            param_hint="--only",
        )
    return [case for case in cases if not only or case.name in only]
