"""An interrupted run ends in order, whenever it is interrupted, and leaves its output and nothing else."""

import json
import os
import signal

import pytest
from process_helpers import endless, recorded, until

from fleet.record.recording import RecordingError

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


def ends_as_interrupted(process, children):
    """Check what every interrupted run has in common; return its messages."""
    assert process.end() == 1, process.complained
    assert process.complained == ""
    assert "Interrupted" in process.told
    process.leaves_nothing(children)
    assert json.loads((process.out / "summary.json").read_text())["verdict"] == "interrupted"
    assert (process.out / "paths.png").exists()
    return recorded(process.out)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_a_run_with_the_verdict_of_its_world(tmp_path, bench, number):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    run.reach(3)
    children = run.children()
    assert len(children) == 3
    run.signal(number)
    key, last = ends_as_interrupted(run, children)[-1]
    assert (key, last.verdict) == ("truth", "interrupted")
    assert last.step >= 3


def test_two_signals_at_once_end_a_run_too(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    run.reach(3)
    children = run.children()
    run.signal(signal.SIGINT)
    run.signal(signal.SIGINT)
    assert ends_as_interrupted(run, children)


def test_a_second_signal_ends_a_run_whose_world_no_longer_answers(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 1))
    run.reach(1)
    children = run.children()
    os.kill(run.pid("world"), signal.SIGSTOP)
    run.signal(signal.SIGINT)
    run.signal(signal.SIGTERM)
    assert ends_as_interrupted(run, children)


@pytest.mark.parametrize("log", ["world", "robot-2"])
def test_a_signal_while_processes_start_ends_them(tmp_path, bench, log):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    until((run.out / "logs" / f"{log}.log").exists, f"the start of {log}")
    children = run.children()
    run.signal(signal.SIGINT)
    ends_as_interrupted(run, children)


@pytest.mark.parametrize("number", SIGNALS[:2])
def test_a_signal_ends_a_simulation(tmp_path, bench, number):
    simulation = bench("out", "simulate", endless(tmp_path / "endless.yaml", 2))

    def has_begun():
        try:
            return len(recorded(simulation.out)) > 1
        except RecordingError:
            return False

    until(has_begun, "the first recorded step")
    simulation.signal(number)
    key, last = ends_as_interrupted(simulation, {})[-1]
    assert (key, last.verdict) == ("truth", "interrupted")
