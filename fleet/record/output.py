"""What a run leaves behind: the recording, the summary, the picture and the logs, in one directory."""

from pathlib import Path
from typing import Self

from chassis.files import empty_directory, write_whole
from chassis.refusal import ExitStatus, Refusal
from fleet.inject.process_faults import FullDisk
from fleet.inject.scenario import warnings_of
from fleet.record.experiment import Experiment
from fleet.record.picture import Course, draw_paths
from fleet.record.recording import BusMessage, Recorder, StreamItem
from fleet.record.summary import Summary, Tally
from protocol.messages import Truth


class Output:
    """Takes a run's messages as they come and writes everything that is kept of them.

    The directory is made if need be; one that holds something is refused, so that no run is lost.

    Raises:
        Refusal: the directory cannot be made, or holds something.
    """

    def __init__(self, directory: Path, experiment: Experiment) -> None:
        empty_directory(directory)
        self.directory = directory
        self.logs = directory / "logs"
        self.tally = Tally()
        self._experiment = experiment
        scenario, facts = experiment.scenario, experiment.facts
        self._course = Course(scenario.step_s)
        self._disk = FullDisk(scenario.faults, seed=facts.seed, step_s=scenario.step_s)
        self._recorder = Recorder(directory / "run.mcap", facts, experiment.text, self._disk.open)

    def __enter__(self) -> Self:
        """Open the recording.

        Raises:
            Refusal: it cannot be opened.
        """
        self._recorder.__enter__()
        return self

    def __exit__(self, *_error: object) -> None:
        """Close the recording, whatever happened."""
        self._recorder.__exit__()

    def take(self, item: StreamItem) -> None:
        """Record a message and count it; what was refused, and who was started again, is only counted.

        Raises:
            Refusal: the disk does not take it.
        """
        if isinstance(item, BusMessage):
            if isinstance(item.message, Truth):
                self._disk.at(item.message.step)
            self._recorder.record(*item)
            self._course.add(item.message)
        self.tally.add(item.message if isinstance(item, BusMessage) else item)

    def finish(self, without_verdict: str) -> Summary:
        """Write the summary and the picture; without the referee's verdict, the given one stands.

        Raises:
            Refusal: the disk does not take them.
        """
        summary = self.tally.summary(
            self._experiment.facts, without_verdict, warnings_of(self._experiment.scenario)
        )
        text = summary.model_dump_json(by_alias=True, indent=2) + "\n"
        try:
            write_whole(self.directory / "summary.json", text)
            draw_paths(self._experiment.scenario, self._course, summary, self.directory / "paths.png")
        except OSError as error:
            where = error.filename or self.directory  # a full disk does not say which file
            raise Refusal(f"{where}: cannot be written: {error.strerror}", ExitStatus.FAILED) from error
        return summary
