"""Faults of processes: robots and worlds that are killed, stopped and started again; disks that are full."""

import itertools
import json
import os
import signal

import pytest
import yaml
from process_helpers import ends_all, lanes, recorded

from protocol.messages import Mind, PublicScene, Truth
from protocol.vehicle import Input, Limits, braking_input


def faulty(path, faults, length_m=2.0, **rules):
    content = {
        "name": path.stem,
        "horizons": {"prediction_steps": 12, "estimation_steps": 3},
        "time_limit_s": 120.0,  # a process that starts again on a busy machine may take its time
        "robots": lanes(2, length_m),
        "faults": faults,
        **rules,
    }
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def summary_of(run):
    return json.loads((run.out / "summary.json").read_text())


def messages_of(run, kind):
    return [message for _, message in recorded(run.out) if isinstance(message, kind)]


def begun(run, robot):
    """At which steps a robot began anew, without any memory."""
    return [mind.step for mind in messages_of(run, Mind) if mind.robot == robot and mind.decision == 0]


def missed(run, robot):
    """Steps that a robot did not answer."""
    true = {truth.step: truth.robots[robot] for truth in messages_of(run, Truth)}
    return [step for step in range(max(true)) if true[step + 1].deadline_misses > true[step].deadline_misses]


def applied(robot):
    return Input(robot.turn_rate_radps, robot.acceleration_mps2)


def test_a_robot_that_a_fault_kills_stops_and_is_no_failure_of_the_run(tmp_path, bench):
    faults = [{"kind": "kill", "robots": [2], "start_s": 0.5}]
    run = bench("out", "run", faulty(tmp_path / "kill.yaml", faults, time_limit_s=3.0))
    assert run.end() == 1, run.complained
    run.leaves_nothing({})
    assert run.complained == ""
    true = {truth.step: truth.robots for truth in messages_of(run, Truth)}
    first = missed(run, "2")[0]
    assert first >= 5
    former, after = true[first + 1]["2"], true[first + 2]["2"]
    braking = braking_input(Limits(), applied(former), former.state.speed_mps, 0.1)
    assert applied(after) == pytest.approx(braking)
    assert true[30]["2"].state.speed_mps == 0.0
    assert true[30]["2"].deadline_misses == 30 - first
    assert true[30]["1"].deadline_misses == 0
    assert summary_of(run)["restarts"] == {}


@pytest.mark.slow
def test_a_robot_that_was_killed_for_a_while_comes_back_without_memory_and_arrives(tmp_path, bench):
    faults = [{"kind": "kill", "robots": [2], "start_s": 0.5, "duration_s": 1.0}]
    # While the other one drives, and for 5 s more, the run is no deadlock, however long the start takes.
    scenario = faulty(tmp_path / "kill.yaml", faults, length_m=9.0)
    run = bench("out", "run", scenario, "--clock", "realtime")
    assert run.end() == 0, run.complained
    assert summary_of(run)["restarts"] == {"robot-2": 1}
    assert len(begun(run, "2")) == 2
    assert len(begun(run, "1")) == 1


@pytest.mark.slow
@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_robot_that_is_stopped_for_a_while_goes_on_with_its_memory(tmp_path, bench, clock):
    faults = [{"kind": "freeze", "robots": [2], "start_s": 0.5, "duration_s": 0.7}]
    run = bench("out", "run", faulty(tmp_path / "freeze.yaml", faults, length_m=4.0), "--clock", clock)
    assert run.end() == 0, run.complained
    assert len(begun(run, "2")) == 1
    assert len(missed(run, "2")) >= 2
    if clock == "lockstep":
        assert missed(run, "1") == []


@pytest.mark.slow
def test_a_world_that_is_restarted_begins_a_new_epoch_with_all_robots(tmp_path, bench):
    faults = [
        {"kind": "kill", "robots": [2], "start_s": 0.3, "duration_s": 1.0},
        {"kind": "restart-world", "start_s": 0.6, "duration_s": 0.5},
    ]
    run = bench("out", "run", faulty(tmp_path / "restart.yaml", faults, length_m=9.0), "--clock", "realtime")
    assert run.end() == 0, run.complained
    run.leaves_nothing({})
    epochs = [epoch for epoch, _ in itertools.groupby(m.epoch for _, m in recorded(run.out))]
    assert len(epochs) == 2
    assert [scene.epoch for scene in messages_of(run, PublicScene)] == epochs
    last = [truth for truth in messages_of(run, Truth) if truth.epoch == epochs[-1]]
    assert [truth.step for truth in last] == list(range(len(last)))
    summary = summary_of(run)
    assert summary["restarts"]["world"] == 1
    assert summary["steps"] == last[-1].step
    refused = {reason for reasons in summary["refused"].values() for reason in reasons}
    assert "answers another epoch" not in refused, "nobody answers the former world"


@pytest.mark.slow
@pytest.mark.parametrize("pause_s", [0.4, 2.5])
def test_a_run_survives_a_pause_of_the_whole_machine(tmp_path, bench, pause_s):
    faults = [
        {"kind": "pause", "start_s": 0.5, "duration_s": pause_s},
        {"kind": "loss", "robots": [1], "rate": 0.05},
    ]
    run = bench("out", "run", faulty(tmp_path / "pause.yaml", faults))
    assert run.end() == 0, run.complained
    steps = [truth.step for truth in messages_of(run, Truth)]
    assert len(steps) > 20
    assert steps[-1] - len(steps) < 5, "the world waits for its robots and for the bench"


@pytest.mark.slow
def test_a_full_disk_ends_the_run_with_its_reason_and_leaves_what_was_recorded(tmp_path, bench):
    faults = [{"kind": "disk-full", "start_s": 1.0}]
    run = bench("out", "run", faulty(tmp_path / "disk.yaml", faults))
    assert run.end() == 3
    run.leaves_nothing({})
    assert "No space left on device" in run.complained
    assert "Traceback" not in run.complained
    assert messages_of(run, Truth)


@pytest.mark.slow
def test_a_recorder_that_dies_takes_the_run_with_it_and_leaves_what_was_recorded(tmp_path, bench):
    faults = [
        {"kind": "recorder-dies", "start_s": 1.0},
        {"kind": "freeze", "robots": [2], "start_s": 0.9},
        {"kind": "loss", "robots": [1], "start_s": 100.0, "rate": 1.0},
    ]
    run = bench("out", "run", faulty(tmp_path / "dies.yaml", faults, 9.0))
    run.logs("world", "all robots present")
    children = run.children()
    assert run.end() == -signal.SIGKILL
    ends_all(children)
    assert len(children) == 4
    assert messages_of(run, Truth)
    assert os.listdir(run.out / "logs")
