"""``unspoken evaluate``: the command line."""

import os
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from agent.estimate import DEFAULT_GOALS, GoalsName
from agent.process.options import checked_goals
from agent.solve import SolverName
from fleet.evaluate.evaluation import Evaluation
from fleet.evaluate.noise import GRAMMAR, LevelError, levels_in
from fleet.record.machine import this_machine
from fleet.scenarios.suite import Suite, load_suite

METHODS = get_args(GoalsName)
PUBLISHED: tuple[GoalsName, ...] = ("exchanged", "ioc", "constant-acceleration")
"""What the publication compares."""
USUAL = ",".join((*PUBLISHED, DEFAULT_GOALS))
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _checked_methods(text: str) -> str:
    """A list of methods that can all be used here, so that none turns out to be missing after hours."""
    for name in _chosen(text, METHODS, "--goals"):
        checked_goals(name)
    return text


def evaluate(
    suite: Annotated[
        str,
        typer.Argument(
            metavar="SUITE",
            help="A directory of scenario files, the name of a bundled suite, or a single scenario.",
        ),
    ],
    goals: Annotated[
        str,
        typer.Option(
            metavar="NAME,NAME,…",
            callback=_checked_methods,
            help=f"Methods to compare: {', '.join(METHODS)}.",
        ),
    ] = USUAL,
    solver: Annotated[SolverName, typer.Option(help="What solves the trajectory problems.")] = "realtime",
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds of sensor noise: 0, 1, …")] = 1,
    noise: Annotated[
        str, typer.Option(metavar="LEVEL,LEVEL,…", help=f"How well robots see: {GRAMMAR}.")
    ] = "none",
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes on this machine.", show_default="one a core"),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Scheduler of a Dask cluster that makes the runs, such as tcp://host:8786.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for the results; one of the same evaluation is gone on with.",
            show_default="runs/evaluation-<suite>-<time>",
            file_okay=False,
        ),
    ] = None,
) -> None:
    """Run every scenario of a suite with every method, seed and level of noise, in virtual time and parallel.

    Each finished run is a row of runs.csv at once. Ctrl-C ends it; the same command with the same --out goes
    on with what is missing. docs/evaluation.md explains the columns.

    Exit status: 0 all runs were made, whatever their verdicts; 1 interrupted; 2 wrong usage; 3 a run failed
    with an exception, or the rest could not be made.
    """
    if workers is not None and dask is not None:
        raise typer.BadParameter(
            "the cluster of --dask has its own workers; leave out one of --workers and --dask",
            param_hint="--workers",
        )
    loaded = _loaded(suite)
    evaluation = Evaluation(
        suite=loaded.name,
        goals=_chosen(goals, METHODS, "--goals"),
        solver=solver,
        seeds=seeds,
        noise=_levels(noise),
        machine=this_machine(),
        begun=datetime.now().astimezone().replace(microsecond=0),
        scenarios=dict(loaded.scenarios),
    )
    directory = out or Path("runs") / f"evaluation-{loaded.name}-{datetime.now():%Y%m%d-%H%M%S}"
    from fleet.evaluate.conducting import conduct  # Dask takes long to import

    raise typer.Exit(conduct(evaluation, directory, workers or CORES, dask))


def _chosen(text: str, names: tuple[str, ...], option: str) -> Any:
    """The names of a list with commas, each once; pydantic knows their type."""
    chosen = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    unknown = [name for name in chosen if name not in names]
    if unknown:
        raise typer.BadParameter(
            f"{unknown[0]!r} found, one or more of {', '.join(names)} with commas between are expected",
            param_hint=option,
        )
    return chosen


def _levels(text: str) -> tuple[str, ...]:
    try:
        return levels_in(text)
    except LevelError as error:
        raise typer.BadParameter(f"{error}; {GRAMMAR}", param_hint="--noise") from None


def _loaded(suite: str) -> Suite:
    return load_suite(suite)
