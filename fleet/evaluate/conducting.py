"""Conducts an evaluation for a person: shows how far it is, keeps every run, and tells what came out."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from distributed import Client
from rich.console import Console
from rich.progress import Progress

from fleet.evaluate.cluster import LostError, UnreachableError, existing_cluster, local_cluster, rows
from fleet.evaluate.evaluation import Evaluation, Run
from fleet.evaluate.results import Results, ResultsError
from fleet.evaluate.table import method_table
from fleet.interruption import Interruption
from fleet.run.processes import ProcessFailedError
from fleet.run.progress import announced, compile_solver, progress_of_many
from world.process import ExitStatus

WIDTH = 110
"""What the table needs."""


def conduct(evaluation: Evaluation, directory: Path, workers: int, dask: str | None) -> ExitStatus:
    """Make all runs that are not there yet, and print the table of all that are.

    Args:
        evaluation: what to run.
        directory: for the results; new, empty, or that of the same evaluation.
        workers: processes on this machine.
        dask: address of the scheduler of an existing cluster to use instead; None for none.
    """
    console = Console(highlight=False, width=max(Console().width, WIDTH))
    errors = Console(stderr=True, highlight=False)
    try:
        with Results(directory, evaluation) as results, Interruption() as interruption:
            complaint = _make_runs(evaluation, results, interruption, workers, dask, errors)
    except (ResultsError, UnreachableError) as error:
        _tell(errors, f"unspoken: {error}")
        return ExitStatus.WRONG_USAGE
    done = [results.rows[run.key] for run in evaluation.runs() if run.key in results.rows]
    if done:
        console.print(method_table(done))
    _tell(console, f"Results in {directory}: {', '.join(sorted(path.name for path in directory.iterdir()))}")
    if complaint is not None:
        _tell(errors, f"unspoken: {complaint}")
        return ExitStatus.FAILED
    if interruption.requested:
        total = sum(1 for _ in evaluation.runs())
        _tell(
            errors,
            f"Interrupted: {len(done)} of {total} runs are kept; to go on with the others give the same "
            f"command with --out {directory}",
        )
        return ExitStatus.ENDED_OTHERWISE
    return ExitStatus.FAILED if any(row.failed for row in done) else ExitStatus.ARRIVED


def _make_runs(
    evaluation: Evaluation,
    results: Results,
    interruption: Interruption,
    workers: int,
    dask: str | None,
    errors: Console,
) -> Exception | None:
    """Make the missing runs as far as possible; what prevented the rest, unless it was an interruption."""
    runs = list(evaluation.runs())
    missing = [run for run in runs if run.key not in results.rows]
    _tell_beforehand(evaluation, len(runs), len(runs) - len(missing), errors)
    if not missing:
        return None
    try:
        with progress_of_many(errors) as progress:
            if dask is None:
                line = progress.add_task(announced("starting"), total=None, failed="")
                compile_solver(interruption)
                progress.remove_task(line)
            with _cluster(dask, min(workers, len(missing))) as client:
                _follow(client, missing, results, interruption, progress)
    except KeyboardInterrupt:
        return None
    except (LostError, ProcessFailedError, ResultsError) as error:
        return error
    return None


def _follow(
    client: Client, missing: Sequence[Run], results: Results, interruption: Interruption, progress: Progress
) -> None:
    failed = sum(row.failed for row in results.rows.values())
    total = len(results.rows) + len(missing)
    line = progress.add_task("runs", total=total, completed=len(results.rows), failed=f"{failed} failed")
    for row in rows(client, missing, interruption):
        results.add(row)
        failed += row.failed
        progress.update(line, advance=1, failed=f"{failed} failed")


def _cluster(dask: str | None, workers: int) -> AbstractContextManager[Client]:
    return local_cluster(workers) if dask is None else existing_cluster(dask)


def _tell_beforehand(evaluation: Evaluation, total: int, there: int, errors: Console) -> None:
    """What a person may wonder about: runs that are not made."""
    if evaluation.spared_seeds:
        _tell(
            errors,
            f"Without noise all seeds give the same run: seed 0 only for {evaluation.spared_seeds} of "
            f"{len(evaluation.scenarios) * len(evaluation.noise)} scenarios and levels of noise",
        )
    if there:
        _tell(errors, f"{there} of {total} runs are there already")


def _tell(console: Console, text: str) -> None:
    """Long lines hold paths, which are not to be broken."""
    console.print(text, markup=False, soft_wrap=True)
