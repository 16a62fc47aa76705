"""Makes a report for a person: reads an evaluation, drives its worst runs again, writes the page."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from chassis.files import write_whole
from chassis.refusal import ExitStatus
from fleet.evaluate.evaluation import Evaluation
from fleet.evaluate.results import read_evaluation, read_rows
from fleet.interruption import Interruption
from fleet.report.composing import PREFIX, compose
from fleet.report.material import Material
from fleet.report.page import Page
from fleet.report.rerunning import shown_again
from fleet.run.experiment import SHARING
from fleet.run.progress import announced, compile_solver
from protocol.messages import Truth
from protocol.scenario import scenario_text

PAGE = "report.html"


class ReportError(Exception):
    """There can be no report; the text says why and what to do."""


def conduct(directory: Path, against: str | None, worst: int) -> ExitStatus:
    """Write the report of an evaluation into its directory, or nothing.

    Args:
        directory: of the evaluation.
        against: the method with which the others are compared; None for exchanged goals, or else the first.
        worst: how many of the worst runs to show.
    """
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with Interruption() as interruption:
        try:
            material = _material(directory, against)
            with _progress(errors) as progress:
                page, scenarios = _page(directory, material, worst, interruption, progress)
            if interruption.requested:
                raise KeyboardInterrupt
            written = _write(directory, page, scenarios)
        except ReportError as error:
            _tell(errors, f"unspoken: {error}")
            return ExitStatus.WRONG_USAGE
        except KeyboardInterrupt:
            _tell(errors, "Interrupted: no report was written")
            return ExitStatus.UNMET
    for remark in page.remarks:
        _tell(errors, remark)
    _tell(console, f"Report in {directory / PAGE}; beside it: {', '.join(written)}")
    return ExitStatus.DONE


def _material(directory: Path, against: str | None) -> Material:
    evaluation = read_evaluation(directory)
    by_key = {row.key: row for row in read_rows(directory)}
    rows = [by_key[run.key] for run in evaluation.runs() if run.key in by_key]
    if not rows:
        raise ReportError(
            f"{directory}: not one run of this evaluation is finished, so there is nothing to report; the "
            "`unspoken evaluate` command that began it goes on with it"
        )
    return Material(evaluation, rows, _reference(evaluation, against))


def _reference(evaluation: Evaluation, against: str | None) -> str:
    if against is None:
        return SHARING if SHARING in evaluation.goals else evaluation.goals[0]
    if against not in evaluation.goals:
        raise ReportError(
            f"--against: {against!r} found, one of the methods of this evaluation is expected: "
            f"{', '.join(evaluation.goals)}"
        )
    return against


def _page(
    directory: Path, material: Material, worst: int, interruption: Interruption, progress: Progress
) -> tuple[Page, dict[str, str]]:
    """The page, and the scenarios of the worst runs by the names of their files."""
    chosen = material.worst(worst)
    if chosen:
        line = progress.add_task(announced("driving the worst runs again"), total=None)
        compile_solver(interruption)
        progress.remove_task(line)
    shown, scenarios = [], {}
    for number, each in enumerate(chosen, 1):
        name = f"{PREFIX}worst-{number}"
        scenarios[f"{name}.yaml"] = scenario_text(material.runs[each.row.key].scenario)
        begin = f"worst run {number} of {len(chosen)}: {material.named(each.row)}"
        line = progress.add_task(begin, total=None)

        def show(truth: Truth, line: TaskID = line, begin: str = begin) -> None:
            progress.update(line, description=f"{begin} · {truth.time_s:.1f} s")

        shown.append(shown_again(material, each, directory / name, show, lambda: interruption.requested))
    progress.add_task("composing the page", total=None)
    return compose(material, shown), scenarios


def _write(directory: Path, page: Page, scenarios: dict[str, str]) -> Sequence[str]:
    """Write the files beside the page first, then the page; what is left of an older report goes."""
    files: dict[str, str | bytes] = {picture.file: picture.png for picture in page.pictures}
    files |= scenarios
    try:
        for name, content in {**files, PAGE: page.html()}.items():
            write_whole(directory / name, content)
        for old in directory.glob(f"{PREFIX}*"):
            if old.name not in files and old.suffix in (".png", ".yaml"):
                old.unlink()
    except OSError as error:
        raise ReportError(
            f"{error.filename or directory}: cannot be written: {error.strerror}; make room or get the "
            "right to write there, then give the same command"
        ) from None
    return sorted(files)


def _progress(console: Console) -> Progress:
    return Progress(
        SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn(), console=console
    )


def _tell(console: Console, text: str) -> None:
    console.print(text, markup=False, soft_wrap=True)
