"""Conducts a bench for a person: shows how it is getting on, prints the tables and writes the JSON."""

from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from fleet.bench.measuring import Measuring
from fleet.bench.report import show
from fleet.bench.settings import Settings
from fleet.bench.watch import Watch
from fleet.interruption import Interruption
from fleet.record.report_file import TO_STDOUT, write_report
from fleet.run.processes import ProcessFailedError
from world.process import ExitStatus

WIDTH = 120
"""What the widest table needs."""


def conduct(settings: Settings, json: Path | None) -> ExitStatus:
    """Measure, print, write.

    Args:
        settings: what to measure.
        json: where the report goes as JSON; ``-`` is the standard output, and the tables then go to the
            standard error.
    """
    errors = _console(stderr=True)
    console = errors if json == TO_STDOUT else _console(stderr=False)
    measuring = Measuring(settings)
    if json not in (None, TO_STDOUT) and not write_report(
        measuring.report().to_json(), json, errors
    ):  # not after minutes
        return ExitStatus.WRONG_USAGE
    status = _measure(measuring, errors)
    report = measuring.report()
    show(report, console)
    return status if json is None or write_report(report.to_json(), json, errors) else ExitStatus.FAILED


def _measure(measuring: Measuring, errors: Console) -> ExitStatus:
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Interruption() as interruption, Progress(*columns, console=errors, transient=True) as progress:
        line = progress.add_task("", total=None)
        try:
            measuring.go(Watch(interruption, lambda what: progress.update(line, description=what)))
        except KeyboardInterrupt:
            return ExitStatus.ENDED_OTHERWISE
        except ProcessFailedError as error:
            errors.print(f"unspoken: {error}", markup=False, soft_wrap=True)
            return ExitStatus.FAILED
    return ExitStatus.ARRIVED


def _console(*, stderr: bool) -> Console:
    """One whose tables are never cut: on a narrow terminal their lines go on in the next one."""
    width = max(Console(stderr=stderr).width, WIDTH)
    return Console(stderr=stderr, highlight=False, width=width)
