"""The directory of a run: never one that holds something, and complete however the run went."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from agent.process.options import DecisionOptions
from chassis.refusal import Refusal
from fleet.record.output import Output
from fleet.record.recording import read_recording
from fleet.record.stream import BusMessage
from fleet.run.experiment import Experiment, prepare
from protocol.keys import Keys
from protocol.messages import Truth


@pytest.fixture
def experiment() -> Experiment:
    return prepare("2-crossing", DecisionOptions(goals="ioc", solver="reference"), clock="lockstep", seed=0)


@pytest.fixture
def truth(experiment: Experiment, make_truth: Callable[..., Truth]) -> BusMessage:
    last = make_truth(4, {"1": {"arrived_s": 0.4}, "2": {"arrived_s": 0.3}}, verdict="arrived")
    return BusMessage(Keys(experiment.facts.run).truth, last, 0)


def test_everything_stands_in_one_directory(
    tmp_path: Path, experiment: Experiment, truth: BusMessage
) -> None:
    directory = tmp_path / "runs" / "first"
    with Output(directory, experiment) as output:
        output.take(truth)
    summary = output.finish(without_verdict="interrupted")
    assert (summary.verdict, summary.duration_s) == ("arrived", 0.4)
    assert {path.name for path in directory.iterdir()} == {"summary.json", "run.mcap", "paths.png"}
    recording = read_recording(directory / "run.mcap")
    assert list(recording) == [truth[:2]]
    assert recording.scenario_text == experiment.path.read_text()
    assert recording.facts == experiment.facts


def test_a_directory_that_is_there_and_empty_is_used(tmp_path: Path, experiment: Experiment) -> None:
    with Output(tmp_path, experiment) as output:
        pass
    output.finish(without_verdict="interrupted")
    assert (tmp_path / "summary.json").exists()


def test_a_directory_that_holds_something_is_left_as_it_is(tmp_path: Path, experiment: Experiment) -> None:
    (tmp_path / "summary.json").write_text("of an older run")
    with pytest.raises(Refusal, match=r"is not empty.*--out"), Output(tmp_path, experiment):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]
    assert (tmp_path / "summary.json").read_text() == "of an older run"


def test_a_directory_that_cannot_be_made_is_an_error(tmp_path: Path, experiment: Experiment) -> None:
    (tmp_path / "file").touch()
    directory = tmp_path / "file" / "run"
    with (
        pytest.raises(Refusal, match=f"{directory} cannot be used for the output: Not a directory"),
        Output(directory, experiment),
    ):
        pass


def test_a_run_that_ended_without_a_verdict_gets_the_given_one(
    tmp_path: Path, experiment: Experiment
) -> None:
    with Output(tmp_path, experiment) as output:
        pass
    output.finish(without_verdict="failed")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["verdict"], summary["steps"], summary["robots"]) == ("failed", 0, [])


def test_a_summary_that_cannot_be_written_is_an_error_that_names_it(
    tmp_path: Path, experiment: Experiment
) -> None:
    with Output(tmp_path, experiment) as output:
        (tmp_path / "summary.json").mkdir()
    with pytest.raises(Refusal, match=r"summary\.json.* cannot be written: Is a directory"):
        output.finish(without_verdict="failed")
