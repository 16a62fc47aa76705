"""``unspoken report``: reads an evaluation, drives its worst runs again, and writes the page."""

import io
import math
import shlex
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from chassis.files import write_whole
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import DIED, FAILED, Row, read_evaluation, read_rows
from fleet.interruption import Interruption, announced, compile_solver
from fleet.record.experiment import SHARING
from fleet.record.picture import Course, draw_paths
from fleet.record.summary import Summary, Tally
from fleet.report.data import Data
from fleet.report.figures import Picture
from fleet.report.page import PREFIX, Page, WorstRun, compose
from fleet.run.virtual import closed_loop
from protocol.scenario import scenario_text

PAGE = "report.html"


def report(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="A directory written by unspoken evaluate.")
    ],
    against: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The method to compare the others with, scenario by scenario.",
            show_default="exchanged, or else the first",
        ),
    ] = None,
    worst: Annotated[int, typer.Option(min=0, help="Number of worst runs to repeat and show.")] = 4,
) -> None:
    """Write the HTML report of an evaluation: report.html in its directory, with its figures as PNG files.

    It shows box plots with the paper's medians, tables with confidence intervals, and the worst runs. An
    incomplete evaluation can be reported too. The page needs no network access and no scripts.

    Exit status: 0 written; 1 interrupted, nothing written; 2 invalid usage, or there is nothing to report;
    3 the solver cannot be compiled, or the page cannot be written.
    """
    data = _data(directory, against)
    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    with Interruption() as interruption:
        try:
            with Progress(*columns, console=Console(stderr=True, highlight=False)) as progress:
                runs = _worst_runs_again(directory, data, worst, progress, interruption)
                progress.add_task("composing the page", total=None)
                page = compose(data, runs)
            if interruption.requested:
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            raise Refusal("Interrupted: no report was written", ExitStatus.UNMET) from None
        written = _write(directory, page, runs)
    for remark in page.remarks:
        typer.echo(remark, err=True)
    typer.echo(f"Report in {directory / PAGE}; beside it: {', '.join(written)}")


def _data(directory: Path, against: str | None) -> Data:
    evaluation = read_evaluation(directory)
    by_key = {row.key: row for row in read_rows(directory)}
    rows = [by_key[run.key] for run in evaluation.runs() if run.key in by_key]
    if not rows:
        raise Refusal(
            f"{directory}: not one run of this evaluation is finished, so there is nothing to report; the "
            "`unspoken evaluate` command that began it makes the missing runs"
        )
    if against is None:
        against = SHARING if SHARING in evaluation.goals else evaluation.goals[0]
    elif against not in evaluation.goals:
        raise Refusal(
            f"--against: {against!r} found, one of the methods of this evaluation is expected: "
            f"{', '.join(evaluation.goals)}"
        )
    return Data(evaluation, rows, against)


def worst_runs(rows: Sequence[Row], against: str, count: int) -> list[tuple[Row, str]]:
    """The worst runs with why they are: failed ones, then with collisions, then without arrival, then slow.

    Slow is what takes long beside the same scenario, noise and seed with the reference method ``against``.
    """
    base_s = {(row.scenario, row.noise, row.seed): row.duration_s for row in rows if row.method == against}
    judged = [(row, *_judged(row, against, base_s.get((row.scenario, row.noise, row.seed)))) for row in rows]
    judged.sort(key=lambda each: each[1])
    return [(row, why) for row, _, why in judged[:count]]


def _judged(row: Row, against: str, base_s: float | None) -> tuple[tuple[float, ...], str]:
    """How good a run is, the worst least, and what is to be said of it; the reference took ``base_s``."""
    if row.failed:
        return (0.0,), f"failed: {row.reason}"
    nearest_m = math.inf if row.minimum_distance_m is None else row.minimum_distance_m
    if row.collisions:
        pairs = "1 pair of robots" if row.collisions == 1 else f"{row.collisions} pairs of robots"
        return (1.0, -row.collisions, nearest_m), f"collision of {pairs}"
    if row.duration_s is None:
        arrived = row.arrived or 0
        return (2.0, arrived / row.robots, nearest_m), (
            f"{row.verdict}: {arrived} of {row.robots} robots arrived"
        )
    took = f"took {row.duration_s:.1f} s"
    if not base_s:  # whoever starts at its goal arrives after 0 s
        return (3.0, 0.0, -row.duration_s), took
    ratio = row.duration_s / base_s
    if row.method != against:
        took += f", {ratio:.2f} times as long as with {against}"
    return (3.0, -ratio, -row.duration_s), took


def _worst_runs_again(
    directory: Path, data: Data, count: int, progress: Progress, interruption: Interruption
) -> list[WorstRun]:
    """Drive the worst runs again, and show how far they are.

    Raises:
        KeyboardInterrupt: interrupted.
        Refusal: the solver cannot be compiled.
    """
    chosen = worst_runs(data.rows, data.against, count)
    if chosen:
        line = progress.add_task(announced("driving the worst runs again"), total=None)
        compile_solver(interruption)
        progress.remove_task(line)
    runs = []
    for number, (row, why) in enumerate(chosen, 1):
        path, title = directory / f"{PREFIX}worst-{number}", data.title_of(row)
        run = data.runs[row.key]
        command = ["unspoken", "simulate", str(path.with_suffix(".yaml")), "--goals", run.key.method]
        command += ["--solver", run.key.solver, "--seed", str(run.key.seed)]
        command += [] if run.reserve else ["--no-reserve"]
        shown = WorstRun(path.name, title, why, shlex.join(command), scenario_text(run.scenario))
        begin = f"worst run {number} of {len(chosen)}: {title}"
        runs.append(_driven_again(shown, row, run, begin, progress, interruption))
    return runs


def _driven_again(
    shown: WorstRun, row: Row, run: Run, begin: str, progress: Progress, interruption: Interruption
) -> WorstRun:
    """Drive a run again and add its picture, as far as it came; the line of progress begins with ``begin``.

    Raises:
        KeyboardInterrupt: it was interrupted, which is looked at once a step.
    """
    if row.reason == DIED:
        return shown._replace(remarks=["Not driven again for a picture: it might end this process too."])
    line = progress.add_task(begin, total=None)
    tally, course, failure = Tally(), Course(run.scenario.step_s), ""
    try:
        for moment in closed_loop(run.scenario, run.facts, time.thread_time, lambda: interruption.requested):
            progress.update(line, description=f"{begin} · {moment.truth.time_s:.1f} s")
            for message in (moment.truth, *(decision.mind for decision in moment.decisions.values())):
                tally.add(message)
                course.add(message)
            if interruption.requested:
                raise KeyboardInterrupt
    except ModuleNotFoundError as error:  # the library of a baseline
        return shown._replace(remarks=[f"Not driven again for a picture: {error} on this machine."])
    except Exception as error:  # the very one that is looked for, or another one, which is reported
        failure = f"{type(error).__name__}: {error}"
    progress.update(line, total=1, completed=1)
    summary = tally.summary(run.facts, FAILED)
    png = io.BytesIO()
    draw_paths(run.scenario, course, summary, png)
    words = (
        f"{shown.title}: the ways driven, the robots, their goals and the estimates of these, at three times."
    )
    remarks = []
    if differences := _differences(row, summary):
        remarks.append(
            "The picture shows another run than the evaluation's: this software on this machine drives it "
            f"with {', '.join(differences)}."
        )
    if failure and failure not in shown.why:
        remarks.append(f"The run of the picture ended with {failure}.")
    return shown._replace(picture=Picture(f"{shown.name}.png", png.getvalue(), words), remarks=remarks)


def _differences(row: Row, summary: Summary) -> list[str]:
    """In what a run is not that of the evaluation; none where software and processor are the same."""
    names = {"verdict": "verdict"}
    if not row.failed:  # such a row holds nothing more
        names |= {"duration": "duration_s", "smallest distance": "minimum_distance_m", "steps": "steps"}
    both = {name: (getattr(row, field), getattr(summary, field)) for name, field in names.items()}
    return [f"{name} {now} instead of {then}" for name, (then, now) in both.items() if then != now]


def _write(directory: Path, page: Page, runs: Sequence[WorstRun]) -> list[str]:
    """Write the files beside the page first, then the page; what is left of an older report goes."""
    contents: dict[str, str | bytes] = {picture.file: picture.png for picture in page.pictures}
    contents |= {f"{run.name}.yaml": run.scenario for run in runs}
    try:
        for name, content in {**contents, PAGE: page.html}.items():
            write_whole(directory / name, content)
        for old in directory.glob(f"{PREFIX}*"):
            if old.name not in contents and old.suffix in (".png", ".yaml"):
                old.unlink()
    except OSError as error:
        raise Refusal(
            f"{error.filename or directory}: cannot be written: {error.strerror}; make room or get the "
            "right to write there, then give the same command",
            ExitStatus.FAILED,
        ) from None
    return sorted(contents)
