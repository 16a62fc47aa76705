"""``unspoken evaluate``: the command line, the progress and the table at the end."""

from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from statistics import median
from typing import Annotated, cast, get_args

import typer
from rich.console import Console
from rich.table import Table

from agent.estimate import DEFAULT_GOALS, GoalsName
from agent.process.options import DecisionOptions, checked_goals
from agent.solve import SolverName
from chassis.options import option
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.evaluation import GRAMMAR, Evaluation, levels_in
from fleet.evaluate.results import Results, Row, open_results
from fleet.interruption import Interruption, announced, compile_solver
from fleet.record.encounters import DistanceQuantiles, pooled
from fleet.record.report import CORES, new_table, number, progress_of_many, this_machine
from fleet.scenarios.suite import load_suite

METHODS = get_args(GoalsName)
PUBLISHED: tuple[GoalsName, ...] = ("exchanged", "ioc", "constant-acceleration")
"""What the publication compares."""
WIDTH = 110
"""What the table needs."""


def _methods(text: str) -> str:
    """A list of methods, each once, that can all be used here: none turns out to be missing after hours."""
    names = list(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in names:
        if name not in METHODS:
            raise typer.BadParameter(
                f"{name!r} found, one or more of {', '.join(METHODS)} with commas between are expected"
            )
        checked_goals(cast("GoalsName", name))
    return ",".join(names)


def _levels(text: str) -> str:
    try:
        return ",".join(levels_in(text))
    except ValueError as error:
        raise typer.BadParameter(f"{error}; --noise takes {GRAMMAR}") from None


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
            callback=_methods,
            help=f"Methods to compare: {', '.join(METHODS)}.",
        ),
    ] = ",".join((*PUBLISHED, DEFAULT_GOALS)),
    solver: Annotated[SolverName, typer.Option(help="Solver for the trajectory problems.")] = "realtime",
    reserve: Annotated[bool, option(DecisionOptions, "reserve")] = True,
    seeds: Annotated[int, typer.Option(min=1, help="Number of noise seeds: 0, 1, …")] = 1,
    noise: Annotated[
        str,
        typer.Option(metavar="LEVEL,LEVEL,…", callback=_levels, help=f"Sensing quality: {GRAMMAR}."),
    ] = "none",
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Number of worker processes on this machine.", show_default="one per core"),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Scheduler of a Dask cluster that executes the runs instead, such as tcp://host:8786.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for the results; an incomplete evaluation in it is resumed.",
            show_default="runs/evaluation-<suite>-<time>",
            file_okay=False,
        ),
    ] = None,
) -> None:
    """Run every scenario of a suite with every method, seed and noise level, in virtual time and in parallel.

    Each finished run is saved in runs.csv immediately. Ctrl-C ends the evaluation; the same command with
    the same --out completes the missing runs. docs/evaluation.md explains the columns.

    Exit status: 0 all runs were completed, whatever their verdicts; 1 interrupted; 2 invalid usage; 3 a run
    failed with an exception, or the rest could not be completed.
    """
    if workers is not None and dask is not None:
        said = "the cluster of --dask has its own workers; leave out one of --workers and --dask"
        raise typer.BadParameter(said, param_hint="--workers")
    loaded = load_suite(suite)
    evaluation = Evaluation(
        suite=loaded.name,
        goals=cast("tuple[GoalsName, ...]", tuple(goals.split(","))),
        solver=solver,
        reserve=reserve,
        seeds=seeds,
        noise=tuple(noise.split(",")),
        machine=this_machine(),
        begun=datetime.now().astimezone().replace(microsecond=0),
        scenarios=loaded.scenarios,
    )
    directory = out or Path("runs") / f"evaluation-{loaded.name}-{datetime.now():%Y%m%d-%H%M%S}"
    total = sum(1 for _ in evaluation.runs())
    with open_results(directory, evaluation) as results, Interruption() as interruption:
        for warning in evaluation.warnings():
            typer.echo(f"Warning: {warning}.", err=True)
        try:
            _make_missing(evaluation, results, workers or CORES, dask, interruption)
        except KeyboardInterrupt:
            raise Refusal(
                f"Interrupted: {len(results.rows)} of {total} runs are kept; to make the others "
                f"give the same command with --out {directory}",
                ExitStatus.UNMET,
            ) from None
        finally:
            _show(evaluation, results, directory)
    if any(row.failed for row in results.rows.values()):
        raise typer.Exit(ExitStatus.FAILED)


def _make_missing(
    evaluation: Evaluation, results: Results, workers: int, dask: str | None, interruption: Interruption
) -> None:
    """Make all runs that are not there yet, and show how far they are.

    Raises:
        KeyboardInterrupt: interrupted.
        Refusal: the rest cannot be made.
    """
    from fleet.evaluate.running import execute, existing_cluster, local_cluster, outcomes  # takes long

    runs = list(evaluation.runs())
    missing = [run for run in runs if run.key not in results.rows]
    there = len(runs) - len(missing)
    if evaluation.spared_seeds:
        typer.echo(
            f"Without noise all seeds give the same run: seed 0 only for {evaluation.spared_seeds} of "
            f"{len(evaluation.scenarios) * len(evaluation.noise)} scenarios and levels of noise",
            err=True,
        )
    if there:
        typer.echo(f"{there} of {len(runs)} runs are there already", err=True)
    if not missing:
        return
    with progress_of_many(Console(stderr=True, highlight=False)) as progress:
        if dask is None:
            line = progress.add_task(announced("starting"), total=None, failed="")
            compile_solver(interruption)
            progress.remove_task(line)
        failed = sum(row.failed for row in results.rows.values())
        with existing_cluster(dask) if dask else local_cluster(min(workers, len(missing))) as client:
            line = progress.add_task("runs", total=len(runs), completed=there, failed=f"{failed} failed")
            for row in outcomes(client, missing, execute, Row.without_result, interruption):
                results.add(row)
                failed += row.failed
                progress.update(line, advance=1, failed=f"{failed} failed")


def _show(evaluation: Evaluation, results: Results, directory: Path) -> None:
    """The table of all finished runs, in the order of the evaluation, and where they are."""
    console = Console(highlight=False, width=max(Console().width, WIDTH))
    done = [results.rows[run.key] for run in evaluation.runs() if run.key in results.rows]
    if done:
        console.print(method_table(done))
        console.print(encounter_table(done))
    typer.echo(f"Results in {directory}: {', '.join(sorted(path.name for path in directory.iterdir()))}")


def method_table(rows: Sequence[Row]) -> Table:
    """One line per method and level of noise; medians over the runs in which all robots arrived."""
    counted = "Runs", "All\narrived", "Collided", "Failed"
    measured = "Duration\nin s", "Mean robot\nin s", "Decide CPU\nms, p99"
    title = "Medians over the runs in which all arrived"
    table = new_table(title, "Method", "Noise", *counted, *measured, names=2)
    for method, noise in dict.fromkeys((row.method, row.noise) for row in rows):
        group = [row for row in rows if (row.method, row.noise) == (method, noise)]
        durations_s = _known(row.duration_s for row in group)
        robot_durations_s = _known(row.robot_duration_mean_s for row in group)
        counts = (
            len(group),
            len(durations_s),
            sum(bool(row.collisions) for row in group),
            sum(row.failed for row in group),
        )
        figures = (
            median(durations_s) if durations_s else None,
            median(robot_durations_s) if robot_durations_s else None,
            max(_known(row.decide_cpu_p99_ms for row in group), default=None),
        )
        table.add_row(method, noise, *map(str, counts), *map(number, figures))
    return table


def encounter_table(rows: Sequence[Row]) -> Table:
    """One line per method and level of noise: how near robots came in each run, and whether minds agreed."""
    distances = [
        f"{title if index == 0 else ''}\n{name}"
        for title in ("Contact", "Safety")
        for index, name in enumerate(("min", "1 %", "10 %", "median"))
    ]
    title = "Smallest distances of the runs, relative to contact and to the safety distance"
    table = new_table(title, "Method", "Noise", *distances, "Sides\ndiffer", "Interven-\ntions", names=2)
    for method, noise in dict.fromkeys((row.method, row.noise) for row in rows):
        group = [row for row in rows if (row.method, row.noise) == (method, noise)]
        cells: list[str] = []
        for known in (
            _known(row.closest_to_collision for row in group),
            _known(row.closest_to_safety for row in group),
        ):
            cells += (
                [number(value) for _, value in DistanceQuantiles.of(known)] if known else 4 * [number(None)]
            )
        sides = pooled((row.side_disagreement, row.side_pair_steps or 0) for row in group)
        cells.append(number(None) if sides is None else f"{sides:.1%}")
        table.add_row(method, noise, *cells, str(sum(row.interventions or 0 for row in group)))
    return table


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]
