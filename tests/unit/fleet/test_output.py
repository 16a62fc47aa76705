"""What a run leaves and how its end is told, however it went: never in a directory that holds something."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import typer
from run_helpers import file_size_limit, mind, truth

from agent.process.options import DecisionOptions
from chassis.refusal import ExitStatus, Refusal
from fleet.interruption import Interruption
from fleet.record.experiment import Experiment, prepare
from fleet.record.output import Output
from fleet.record.recording import BusMessage, read_recording
from fleet.run.command import conduct
from protocol.keys import Keys


@pytest.fixture
def experiment() -> Experiment:
    return prepare("2-crossing", DecisionOptions(goals="ioc", solver="reference"), clock="lockstep", seed=0)


@pytest.fixture
def told(experiment: Experiment) -> Callable[..., BusMessage]:
    """A message of the referee."""

    def make(step: int, **changes: object) -> BusMessage:
        return BusMessage(Keys(experiment.facts.run).truth, truth(step, {"1": {}, "2": {}}, **changes), 0)

    return make


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without pictures, which take a second each."""
    monkeypatch.setattr("fleet.record.output.draw_paths", lambda *_: None)


def verdict_in(directory: Path) -> str:
    verdict: str = json.loads((directory / "summary.json").read_text())["verdict"]
    return verdict


def test_everything_stands_in_one_directory(
    tmp_path: Path, experiment: Experiment, told: Callable[..., BusMessage]
) -> None:
    directory = tmp_path / "runs" / "first"
    with Output(directory, experiment) as output:
        output.take(told(4, verdict="timeout"))
    assert output.finish(without_verdict="interrupted").verdict == "timeout"
    assert next(iter(json.loads((directory / "summary.json").read_text()))) == "schema"
    assert {path.name for path in directory.iterdir()} == {"summary.json", "run.mcap", "paths.png"}
    recording = read_recording(directory / "run.mcap")
    assert list(recording) == [told(4, verdict="timeout")[:2]]
    assert recording.scenario_text == experiment.path.read_text()
    assert recording.facts == experiment.facts


def test_a_directory_that_holds_something_is_left_as_it_is(tmp_path: Path, experiment: Experiment) -> None:
    (tmp_path / "summary.json").write_text("of an older run")
    with pytest.raises(Refusal, match=r"is not empty.*--out"):
        Output(tmp_path, experiment)
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]
    assert (tmp_path / "summary.json").read_text() == "of an older run"


def test_an_empty_one_is_used_and_what_cannot_be_written_is_named(
    tmp_path: Path, experiment: Experiment
) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(Refusal, match="file/run cannot be used for the output: Not a directory"):
        Output(tmp_path / "file" / "run", experiment)
    (tmp_path / "empty").mkdir()
    with Output(tmp_path / "empty", experiment) as output:
        (tmp_path / "empty" / "summary.json").mkdir()
    with pytest.raises(Refusal, match=r"summary\.json.* cannot be written: Is a directory"):
        output.finish(without_verdict="failed")


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("verdict", "kept"), [(None, "failed"), ("deadlock", "deadlock")])
def test_a_failed_process_is_told_and_what_came_before_is_kept(
    tmp_path: Path,
    experiment: Experiment,
    told: Callable[..., BusMessage],
    verdict: str | None,
    kept: str,
) -> None:
    def stream(_logs: Path, _interruption: Interruption) -> Iterator[BusMessage]:
        yield told(0, verdict=verdict)
        raise Refusal("robot-2 was killed [by] signal 9", ExitStatus.FAILED)

    with pytest.raises(Refusal, match=r"robot-2 was killed \[by\] signal 9") as failure:
        conduct(experiment, tmp_path, stream, "begin")
    assert failure.value.status is ExitStatus.FAILED
    assert verdict_in(tmp_path) == kept
    assert list(read_recording(tmp_path / "run.mcap")) == [told(0, verdict=verdict)[:2]]


@pytest.mark.usefixtures("undrawn")
def test_whoever_insists_does_not_wait_for_a_verdict(
    tmp_path: Path, experiment: Experiment, told: Callable[..., BusMessage]
) -> None:
    closed = []

    def stream(_logs: Path, interruption: Interruption) -> Iterator[BusMessage]:
        try:
            yield told(0)
            interruption.requested = interruption.insisted = True
            yield told(1)
            yield told(2)
        finally:
            closed.append(True)

    with pytest.raises(typer.Exit) as end:
        conduct(experiment, tmp_path, stream, "begin")
    assert end.value.exit_code == ExitStatus.UNMET
    assert verdict_in(tmp_path) == "interrupted"
    assert len(list(read_recording(tmp_path / "run.mcap"))) == 2
    assert closed, "the stream, which holds the processes, is closed"


def test_a_full_disk_ends_the_run_and_everything_that_failed_is_told(
    tmp_path: Path, experiment: Experiment
) -> None:
    closed = []

    def stream(_logs: Path, _interruption: Interruption) -> Iterator[BusMessage]:
        key = Keys(experiment.facts.run).mind("1")
        try:
            for step in range(1000):
                plan = [(step + i / 7.0, step - i / 7.0) for i in range(100)]
                yield BusMessage(key, mind("1", step, plan=plan), 0)
        finally:
            closed.append(True)

    with file_size_limit(20_000), pytest.raises(Refusal) as failure:
        conduct(experiment, tmp_path, stream, "begin")
    sentences = str(failure.value)
    assert failure.value.status is ExitStatus.FAILED
    assert "run.mcap: the recording cannot go on: File too large" in sentences
    assert f"{tmp_path}: cannot be written: File too large" in sentences
    assert verdict_in(tmp_path) == "failed"
    assert closed, "the stream, which holds the processes, is closed"
