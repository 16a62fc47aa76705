"""Conducts one run for a person: shows it, keeps it, and says how it ended."""

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from rich.console import Console

from fleet.interruption import Interruption
from fleet.record.output import Output, OutputError
from fleet.record.recording import RecordingError
from fleet.record.stream import BusMessage, StreamItem
from fleet.record.verdict import degradation_lines, refusal_lines, robot_table, verdict_line
from fleet.run.crew import ProcessFailedError
from fleet.run.experiment import Experiment
from fleet.run.progress import RunProgress
from world.process import ExitStatus

Stream = Callable[[Path, Interruption], Iterator[StreamItem]]
"""Makes a run's messages, given the directory for logs and the wish to end."""


def conduct(experiment: Experiment, directory: Path, stream: Stream, begin: str) -> ExitStatus:
    """Run an experiment to its end, leave its output in a directory and print the verdict.

    Args:
        experiment: what to run.
        directory: for the output; new or empty.
        stream: what runs it.
        begin: what to show until the first step.
    """
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    failure: Exception | None = None
    output = Output(directory, experiment)
    with Interruption() as interruption:
        try:
            with output, RunProgress(console, begin) as progress:
                failure = _follow(stream(output.logs, interruption), output, progress, interruption)
        except OutputError as error:
            _tell(errors, error)
            return ExitStatus.WRONG_USAGE
        except RecordingError as error:
            failure = error
        return _finish(experiment, output, failure, console, errors)


def _follow(
    messages: Iterator[StreamItem],
    output: Output,
    progress: RunProgress,
    interruption: Interruption,
) -> ProcessFailedError | None:
    """Take every message; return a failure of the run, if there is one."""
    with closing(messages):  # type: ignore[type-var]  # generators, whose closing ends the processes
        try:
            for item in messages:
                output.take(item)
                if isinstance(item, BusMessage):
                    progress.show(item.message)
                if interruption.insisted:
                    return None
        except ProcessFailedError as error:
            return error
        except KeyboardInterrupt:
            return None
    return None


def _finish(
    experiment: Experiment, output: Output, failure: Exception | None, console: Console, errors: Console
) -> ExitStatus:
    try:
        summary = output.finish(without_verdict="interrupted" if failure is None else "failed")
    except OutputError as error:
        for each in filter(None, (failure, error)):
            _tell(errors, each)
        return ExitStatus.FAILED
    if summary.robots:
        console.print(robot_table(summary, output.tally.clipped_commands))
    console.print(verdict_line(summary, experiment.scenario.step_s))
    for line in (*refusal_lines(summary), *degradation_lines(summary)):
        console.print(line, markup=False, soft_wrap=True)
    written = ", ".join(sorted(path.name for path in output.directory.iterdir()))
    console.print(f"Recorded in {output.directory}: {written}", markup=False, soft_wrap=True)
    if failure is not None:
        _tell(errors, failure)
        return ExitStatus.FAILED
    return ExitStatus.ARRIVED if summary.verdict == "arrived" else ExitStatus.ENDED_OTHERWISE


def _tell(errors: Console, error: Exception) -> None:
    """Say what is wrong; long lines hold paths and logs, which are not to be broken."""
    errors.print(f"unspoken: {error}", markup=False, soft_wrap=True)
