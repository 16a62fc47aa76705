"""``unspoken faults``: lets things break in many crossings, and says what did not hold."""

import json as to_json
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from statistics import median
from typing import Annotated

import typer
from pydantic_core import PydanticCustomError
from rich.console import Console
from rich.table import Table

from agent.estimate import DEFAULT_GOALS, GoalsName
from agent.process.options import DecisionOptions
from chassis.options import option
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.running import local_cluster, outcomes
from fleet.faults.cases import BUNDLED, Case, load_cases
from fleet.faults.trial import Outcome, Trial, in_processes, in_virtual_time
from fleet.inject.scenario import check_robots
from fleet.interruption import Interruption, announced, compile_solver
from fleet.record.report import (
    CORES,
    TO_STDOUT,
    JsonOption,
    new_table,
    number,
    progress_of_many,
    write_report,
)
from fleet.scenarios.command import checked_numbers, numbers_in

VERSION = 1
"""Of the report."""


def faults(
    suite: Annotated[
        Path | None,
        typer.Argument(
            metavar="SUITE",
            help="A file of cases: faults and guarantees.",
            show_default="the bundled suite, with every kind of fault",
        ),
    ] = None,
    robots: Annotated[
        str,
        typer.Option(callback=checked_numbers, help="Numbers of robots to try.", metavar="N,N..N"),
    ] = "2,4,8",
    seeds: Annotated[
        int, typer.Option(min=1, help="Number of seeds, each of which gives another crossing.")
    ] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed.")] = 0,
    only: Annotated[
        list[str] | None, typer.Option(metavar="CASE", help="Try only this case; can be repeated.")
    ] = None,
    goals: Annotated[GoalsName, option(DecisionOptions, "goals")] = DEFAULT_GOALS,
    processes: Annotated[
        bool, typer.Option("--processes", help="Use real processes, one trial at a time.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Number of worker processes.", show_default="one per core"),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Inject faults into many crossings and check that guarantees hold, in virtual time or in real processes.

    In every trial, no healthy robot may have a collision that it could have avoided by braking, all healthy
    robots must arrive, nothing may go wrong before the fault, and the recording must be complete. A trial
    with a violation is printed with the command that repeats it. docs/faults.md explains the cases.

    Exit status: 0 everything held, 1 something was violated, or interrupted, 2 invalid usage, 3 the trials
    could not be run.
    """
    cases = _chosen(suite or BUNDLED, only, numbers_in(robots), processes)
    tried = product(cases, numbers_in(robots), range(first_seed, first_seed + seeds))
    trials = [Trial(case, number, seed, goals) for case, number, seed in tried]
    console = Console(highlight=False, stderr=json == TO_STDOUT)
    errors = Console(highlight=False, stderr=True)
    done: list[Outcome] = []
    complaint: Refusal | None = None
    try:
        for outcome in _made(trials, workers or CORES, processes, errors):
            done.append(outcome)
    except KeyboardInterrupt:
        pass  # said below
    except Refusal as error:  # what was made before is printed first
        complaint = error
    order = {(trial.case.name, trial.robots, trial.seed): index for index, trial in enumerate(trials)}
    done.sort(key=lambda each: order[each.case, each.robots, each.seed])
    if done:
        console.print(_table(done))
    failed = [each for each in done if each.violations]
    command = " ".join(["unspoken faults", *([str(suite)] if suite else []), f"--goals {goals}"])
    command += " --processes" if processes else ""
    for each in failed:
        console.print(
            f"{each.case}, {each.robots} robots, seed {each.seed}: {'; '.join(each.violations)}\n"
            f"  {command} --only {each.case} --robots {each.robots} --first-seed {each.seed} --seeds 1",
            markup=False,
            soft_wrap=True,
        )
    complete = len(done) == len(trials)
    if json is not None:
        report = {"schema": VERSION, "complete": complete, "trials": [each.model_dump() for each in done]}
        write_report(to_json.dumps(report, indent=2), json)
    if complaint is not None:
        raise complaint
    if not complete:
        errors.print(f"Interrupted: {len(done)} of {len(trials)} trials were made")
    if failed or not complete:
        raise typer.Exit(ExitStatus.UNMET)


def _chosen(path: Path, only: list[str] | None, robots: Sequence[int], processes: bool) -> list[Case]:
    """The cases that are to be tried; each breaks something in every trial."""
    cases = load_cases(path)
    names = [case.name for case in cases]
    if unknown := [name for name in only or () if name not in names]:
        raise typer.BadParameter(
            f"{unknown[0]!r} found, one of the cases of {path} is expected: {', '.join(names)}",
            param_hint="--only",
        )
    chosen = [
        case for case in cases if (not only or case.name in only) and (processes or not case.needs_processes)
    ]
    if not chosen:
        raise typer.BadParameter("in virtual time these cases mean nothing; give --processes")
    for case in chosen:
        try:
            check_robots(case.faults, [str(index + 1) for index in range(min(robots))])
        except PydanticCustomError as error:
            raise typer.BadParameter(
                f"case {case.name!r} of {path}: {error}; give larger numbers", param_hint="--robots"
            ) from None
    return chosen


def _made(trials: Sequence[Trial], workers: int, processes: bool, errors: Console) -> Iterator[Outcome]:
    """Make the trials, and show how far they are."""
    failed = 0
    with Interruption() as interruption, progress_of_many(errors) as progress:
        line = progress.add_task(announced("starting"), total=None, failed="")
        compile_solver(interruption)
        progress.update(line, description="trials", total=len(trials))

        def shown(outcome: Outcome) -> Outcome:
            nonlocal failed
            failed += bool(outcome.violations)
            progress.update(line, advance=1, failed=f"{failed} failed" if failed else "")
            return outcome

        if processes:
            yield from (shown(in_processes(trial, interruption)) for trial in trials)
            return
        with local_cluster(min(workers, len(trials))) as client:
            made = outcomes(client, trials, in_virtual_time, Trial.without_result, interruption)
            yield from map(shown, made)


def _table(outcomes: Sequence[Outcome]) -> Table:
    """One line a case: in how many trials all held, how they ended, and how often robots were held back."""
    headers = "Case|Trials|Hold|All\narrived|With a\ncollision|Inter-\nventions|Median\nin s"
    table = new_table("Trials of faults", *headers.split("|"))
    for case in [*dict.fromkeys(each.case for each in outcomes), "all"]:
        several = [each for each in outcomes if case in (each.case, "all")]
        counts = (
            len(several),
            sum(not each.violations for each in several),
            sum(each.verdict == "arrived" for each in several),
            sum(each.collisions > 0 for each in several),
            sum(each.interventions for each in several),
        )
        table.add_row(case, *map(str, counts), number(median(each.time_s for each in several)))
    return table
