"""A run that cannot go on or leave its output is told in words, with the exit status of a failure."""

import json
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import typer

from agent.process.options import DecisionOptions
from chassis.refusal import ExitStatus, Refusal
from fleet.interruption import Interruption
from fleet.record.recording import read_recording
from fleet.record.stream import BusMessage
from fleet.run.command import conduct
from fleet.run.experiment import Experiment, prepare
from protocol.keys import Keys
from protocol.messages import Mind, Truth


@pytest.fixture
def experiment() -> Experiment:
    return prepare("2-crossing", DecisionOptions(goals="ioc", solver="reference"), clock="lockstep", seed=0)


@pytest.fixture
def truth(experiment: Experiment, make_truth: Callable[..., Truth]) -> Callable[..., BusMessage]:
    """A message of the referee."""

    def make(step: int, **changes: object) -> BusMessage:
        return BusMessage(
            Keys(experiment.facts.run).truth, make_truth(step, {"1": {}, "2": {}}, **changes), 0
        )

    return make


@contextmanager
def file_size_limit(limit_bytes: int) -> Iterator[None]:
    """Files cannot grow beyond this, as on a disk that is full."""
    former = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, former[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, former)


def verdict_in(directory: Path) -> str:
    verdict: str = json.loads((directory / "summary.json").read_text())["verdict"]
    return verdict


def test_a_failed_process_is_told_and_what_came_before_is_kept(
    tmp_path: Path,
    experiment: Experiment,
    truth: Callable[..., BusMessage],
) -> None:
    def stream(_logs: Path, _interruption: Interruption) -> Iterator[BusMessage]:
        yield truth(0)
        raise Refusal("robot-2 was killed [by] signal 9", ExitStatus.FAILED)

    with pytest.raises(Refusal, match=r"robot-2 was killed \[by\] signal 9") as failure:
        conduct(experiment, tmp_path, stream, "begin")
    assert failure.value.status is ExitStatus.FAILED
    assert verdict_in(tmp_path) == "failed"
    assert [message for _, message in read_recording(tmp_path / "run.mcap")] == [truth(0).message]


def test_a_verdict_that_came_before_the_failure_stands(
    tmp_path: Path, experiment: Experiment, truth: Callable[..., BusMessage]
) -> None:
    def stream(_logs: Path, _interruption: Interruption) -> Iterator[BusMessage]:
        yield truth(1, verdict="deadlock")
        raise Refusal("robot-2 was killed", ExitStatus.FAILED)

    with pytest.raises(Refusal, match="robot-2 was killed"):
        conduct(experiment, tmp_path, stream, "begin")
    assert verdict_in(tmp_path) == "deadlock"


def test_who_insists_is_not_made_to_wait_for_a_verdict(
    tmp_path: Path, experiment: Experiment, truth: Callable[..., BusMessage]
) -> None:
    closed = []

    def stream(_logs: Path, interruption: Interruption) -> Iterator[BusMessage]:
        try:
            yield truth(0)
            interruption.requested = interruption.insisted = True
            yield truth(1)
            yield truth(2)
        finally:
            closed.append(True)

    with pytest.raises(typer.Exit) as end:
        conduct(experiment, tmp_path, stream, "begin")
    assert end.value.exit_code == ExitStatus.UNMET
    assert verdict_in(tmp_path) == "interrupted"
    assert len(list(read_recording(tmp_path / "run.mcap"))) == 2
    assert closed, "the stream, which holds the processes, is closed"


def test_a_full_disk_ends_the_run_and_everything_that_failed_is_told(
    tmp_path: Path,
    experiment: Experiment,
    make_mind: Callable[..., Mind],
) -> None:
    closed = []

    def stream(_logs: Path, _interruption: Interruption) -> Iterator[BusMessage]:
        key = Keys(experiment.facts.run).mind("1")
        try:
            for step in range(1000):
                plan = [(step + i / 7.0, step - i / 7.0) for i in range(100)]
                yield BusMessage(key, make_mind("1", step, plan=plan), 0)
        finally:
            closed.append(True)

    with file_size_limit(20_000), pytest.raises(Refusal) as failure:
        conduct(experiment, tmp_path, stream, "begin")
    told = str(failure.value)
    assert failure.value.status is ExitStatus.FAILED
    assert "run.mcap: the recording cannot go on: File too large" in told
    assert f"{tmp_path}: cannot be written: File too large" in told
    assert verdict_in(tmp_path) == "failed"
    assert closed, "the stream, which holds the processes, is closed"
