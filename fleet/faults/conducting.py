"""Conducts trials of faults for a person: shows how far they are, and tells what did not hold."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console

from chassis.refusal import Refusal
from fleet.evaluate.running import local_cluster, outcomes
from fleet.faults import live
from fleet.faults.showing import case_table, failure_lines
from fleet.faults.trial import Outcome, Trial, execute, without_result
from fleet.interruption import Interruption
from fleet.record.report_file import TO_STDOUT, write_report
from fleet.run.processes import ProcessFailedError
from fleet.run.progress import announced, compile_solver, progress_of_many
from world.process import ExitStatus

VERSION = 1


def conduct(
    trials: Sequence[Trial], workers: int, *, processes: bool, command: str, json_path: Path | None
) -> ExitStatus:
    """Make all trials, print the table and every failure.

    Args:
        trials: what to try.
        workers: processes of this machine; trials in real processes are made one after the other.
        processes: whether to run real processes.
        command: that repeats a trial, once it is said which.
        json_path: where the report goes, if anywhere.
    """
    console = Console(highlight=False, stderr=json_path == TO_STDOUT)
    errors = Console(stderr=True, highlight=False)
    done: list[Outcome] = []
    complaint: Exception | None = None
    with Interruption() as interruption, progress_of_many(errors) as progress:
        line = progress.add_task(announced("starting"), total=None, failed="")
        try:
            compile_solver(interruption)
            progress.update(line, description="trials", total=len(trials))
            for outcome in _made(trials, workers, processes, interruption):
                done.append(outcome)
                failed = sum(bool(each.violations) for each in done)
                progress.update(line, advance=1, failed=f"{failed} failed" if failed else "")
        except KeyboardInterrupt:
            pass  # said below
        except (Refusal, ProcessFailedError) as error:
            complaint = error
    order = {(trial.case.name, trial.robots, trial.seed): index for index, trial in enumerate(trials)}
    done.sort(key=lambda each: order[each.case, each.robots, each.seed])
    if done:
        console.print(case_table(done))
    for text in failure_lines(done, command):
        console.print(text, markup=False, soft_wrap=True)
    if json_path is not None:
        write_report(_report(done, len(trials)), json_path)
    if complaint is not None:
        errors.print(f"unspoken: {complaint}", markup=False, soft_wrap=True)
        return ExitStatus.FAILED
    if len(done) < len(trials):
        errors.print(f"Interrupted: {len(done)} of {len(trials)} trials were made")
        return ExitStatus.ENDED_OTHERWISE
    return ExitStatus.ENDED_OTHERWISE if any(each.violations for each in done) else ExitStatus.ARRIVED


def _made(
    trials: Sequence[Trial], workers: int, processes: bool, interruption: Interruption
) -> Iterator[Outcome]:
    if processes:
        for trial in trials:
            yield live.execute(trial, interruption)
        return
    with local_cluster(min(workers, len(trials))) as client:
        yield from outcomes(client, trials, execute, without_result, interruption)


def _report(done: Sequence[Outcome], wanted: int) -> str:
    return json.dumps(
        {
            "schema": VERSION,
            "complete": len(done) == wanted,
            "trials": [each.model_dump() for each in done],
        },
        indent=2,
    )
