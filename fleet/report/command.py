"""``unspoken report``: reads an evaluation, drives its worst runs again, and writes the page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from chassis.files import write_whole
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.evaluation import Evaluation
from fleet.evaluate.results import read_evaluation, read_rows
from fleet.interruption import Interruption
from fleet.report.data import Data
from fleet.report.page import PREFIX, Page, compose
from fleet.report.worst import driven_again, worst_runs
from fleet.run.experiment import SHARING
from fleet.run.progress import announced, compile_solver
from protocol.messages import Truth
from protocol.scenario import scenario_text

PAGE = "report.html"


def report(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="A directory that unspoken evaluate has written.")
    ],
    against: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The method with which the others are compared, scenario by scenario.",
            show_default="exchanged, or else the first",
        ),
    ] = None,
    worst: Annotated[
        int, typer.Option(min=0, help="How many of the worst runs are driven again and shown.")
    ] = 4,
) -> None:
    """Make a page of an evaluation: report.html in its directory, and its figures as PNG files beside it.

    It shows box plots beside the publication's medians, tables with confidence intervals, and the worst runs.
    An evaluation that is not finished is reported as far as it is. The page needs no network and no scripts.

    Exit status: 0 written; 1 interrupted, nothing written; 2 wrong usage, or there is nothing to report;
    3 the solver cannot be compiled, or the page cannot be written.
    """
    errors = Console(stderr=True, highlight=False)
    data = _data(directory, against)
    with Interruption() as interruption:
        try:
            page, scenarios = _page(directory, data, worst, interruption, errors)
            if interruption.requested:
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            raise Refusal("Interrupted: no report was written", ExitStatus.UNMET) from None
        written = _write(directory, page, scenarios)
    for remark in page.remarks:
        errors.print(remark, markup=False, soft_wrap=True)
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
    return Data(evaluation, rows, _reference(evaluation, against))


def _reference(evaluation: Evaluation, against: str | None) -> str:
    if against is None:
        return SHARING if SHARING in evaluation.goals else evaluation.goals[0]
    if against not in evaluation.goals:
        raise Refusal(
            f"--against: {against!r} found, one of the methods of this evaluation is expected: "
            f"{', '.join(evaluation.goals)}"
        )
    return against


def _page(
    directory: Path, data: Data, count: int, interruption: Interruption, errors: Console
) -> tuple[Page, dict[str, str]]:
    """The page, and the scenarios of the worst runs by the names of their files."""
    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    with Progress(*columns, console=errors) as progress:
        chosen = worst_runs(data.rows, data.against, count)
        if chosen:
            line = progress.add_task(announced("driving the worst runs again"), total=None)
            compile_solver(interruption)
            progress.remove_task(line)
        shown, scenarios = [], {}
        for number, each in enumerate(chosen, 1):
            run, title, name = data.runs[each.row.key], data.title_of(each.row), f"{PREFIX}worst-{number}"
            scenarios[f"{name}.yaml"] = scenario_text(run.scenario)
            begin = f"worst run {number} of {len(chosen)}: {title}"
            line = progress.add_task(begin, total=None)

            def show(truth: Truth, line: TaskID = line, begin: str = begin) -> None:
                progress.update(line, description=f"{begin} · {truth.time_s:.1f} s")

            shown.append(
                driven_again(run, each, title, directory / name, show, lambda: interruption.requested)
            )
            progress.update(line, total=1, completed=1)
        progress.add_task("composing the page", total=None)
        return compose(data, shown), scenarios


def _write(directory: Path, page: Page, scenarios: dict[str, str]) -> Sequence[str]:
    """Write the files beside the page first, then the page; what is left of an older report goes."""
    contents: dict[str, str | bytes] = {picture.file: picture.png for picture in page.pictures}
    contents |= scenarios
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
