"""What a run leaves behind: the recording, the summary, the picture and the logs, in one directory."""

from pathlib import Path
from typing import Self

from chassis.refusal import Refusal
from fleet.inject.process_faults import FullDisk
from fleet.record.picture import Course, draw_paths
from fleet.record.recording import Recorder
from fleet.record.stream import RefusedMind, Restarted, StreamItem
from fleet.record.summary import Summary, Tally
from fleet.run.experiment import Experiment
from protocol.messages import Truth


class OutputError(Refusal):
    """The output directory cannot be used; the text says why and what to do."""


class Output:
    """Takes a run's messages as they come and writes everything that is kept of them.

    Args:
        directory: made if need be; one that holds something already is refused, so that no run is lost.
        experiment: what is run.
    """

    def __init__(self, directory: Path, experiment: Experiment) -> None:
        self.directory = directory
        self.logs = directory / "logs"
        self._experiment = experiment
        self.tally = Tally()
        scenario, text = experiment.scenario, experiment.scenario_text()
        self._course = Course(scenario.step_s)
        self._disk = FullDisk(scenario.faults, seed=experiment.facts.seed, step_s=scenario.step_s)
        self._recorder = Recorder(directory / "run.mcap", experiment.facts, text, self._disk.open)

    def make_directory(self) -> None:
        """Make the directory.

        Raises:
            Refusal: it cannot be made, or holds something.
        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            if any(self.directory.iterdir()):
                raise OutputError(
                    f"{self.directory} is not empty; choose another directory with --out, or remove it"
                )
        except OSError as error:
            raise OutputError(f"{self.directory} cannot be used for the output: {error.strerror}") from error

    def __enter__(self) -> Self:
        """Open the recording.

        Raises:
            RecordingError: it cannot be opened.
        """
        self._recorder.__enter__()
        return self

    def __exit__(self, *_error: object) -> None:
        """Close the recording, whatever happened."""
        self._recorder.__exit__()

    def take(self, item: StreamItem) -> None:
        """Record a message and count it; what was refused, and who was started again, is only counted.

        Raises:
            RecordingError: the disk does not take it.
        """
        if isinstance(item, RefusedMind):
            self.tally.refuse(item)
            return
        if isinstance(item, Restarted):
            self.tally.count_restart(item)
            return
        if isinstance(item.message, Truth):
            self._disk.at(item.message.step)
        self._recorder.record(item.key, item.message, item.time_ns)
        self.tally.add(item.message)
        self._course.add(item.message)

    def finish(self, without_verdict: str) -> Summary:
        """Write the summary and the picture.

        Args:
            without_verdict: the verdict where the referee could not give one.

        Raises:
            OutputError: the disk does not take them.
        """
        summary = self.tally.summary(self._experiment.facts, without_verdict)
        try:
            summary.write(self.directory / "summary.json")
            draw_paths(self._experiment.scenario, self._course, summary, self.directory / "paths.png")
        except OSError as error:
            where = error.filename or self.directory  # a full disk does not tell the file
            raise OutputError(f"{where}: cannot be written: {error.strerror}") from error
        return summary
