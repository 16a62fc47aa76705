"""Processes that die or stop, by themselves or by a fault: who is named, who goes on, and who comes back."""

import itertools
import os
import signal

import pytest
from process_helpers import (
    FAR_SIGHTED,
    brakes,
    endless,
    ends_all,
    lanes,
    recorded,
    until,
    write_scenario,
)

from protocol.messages import Command, PublicScene, Truth

REALTIME_WITH_RESTARTS = ("--clock", "realtime", "--restart", "on-failure")
NEVER_S = 1000.0


def straight(path, robots, **rules):
    """A scenario with patience for processes that start again on a busy machine."""
    return write_scenario(path, robots, **{"horizons": FAR_SIGHTED, "time_limit_s": 120.0, **rules})


def test_a_robot_that_dies_is_named_and_brakes_and_the_others_go_on(tmp_path, bench):
    run = bench("out", "run", straight(tmp_path / "lanes.yaml", lanes(2, 4.0), time_limit_s=4.0))
    run.reach(5)
    children = run.kill("agent", "2")
    assert run.end() == 3
    run.leaves_nothing(children)
    assert "robot-2 was killed by signal 9" in run.complained
    assert "joined" in run.complained, "the end of its log is shown"
    assert "robot-1" not in run.complained
    true = run.true("2")
    last = max(each.step for each in run.messages(Command) if each.robot == "2")
    brakes(true, range(last + 1, 40))
    assert true[40].state.speed_mps == pytest.approx(0.0, abs=1e-9)
    assert run.missed("2") == list(range(last + 1, 40))
    assert run.summary["verdict"] == "timeout"
    arrived_s = {robot["id"]: robot["arrived_s"] for robot in run.summary["robots"]}
    assert arrived_s["1"] is not None
    assert arrived_s["2"] is None


def test_when_a_robot_dies_before_the_first_step_the_run_is_given_up(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    until(lambda: len(run.children()) == 3, "the last robot")
    children = run.kill("agent", "2")
    assert run.end() == 3
    run.leaves_nothing(children)
    assert "robot-2 was killed by signal 9" in run.complained
    assert "Failed before the first step." in run.told


def test_when_the_world_dies_the_run_has_failed_and_keeps_what_was_recorded(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 1))
    run.reach(3)
    children = run.kill("world")
    assert run.end() == 3
    run.leaves_nothing(children)
    assert "world was killed by signal 9" in run.complained
    assert "all robots present" in run.complained, "the end of its log is shown"
    assert "Traceback" not in run.complained
    assert (run.summary["verdict"], run.summary["duration_s"]) == ("failed", None)
    assert run.summary["steps"] >= 3
    assert recorded(run.out)


def test_no_process_outlives_a_bench_that_is_killed_not_even_one_that_is_stopped(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 1))
    run.reach(1)
    children = run.children()
    assert len(children) == 2
    os.kill(run.pid("agent", "1"), signal.SIGSTOP)
    run.signal(signal.SIGKILL)
    assert run.end() == -signal.SIGKILL
    ends_all(children)


@pytest.mark.slow
def test_robots_that_were_killed_by_a_fault_or_otherwise_come_back_without_memory_and_arrive(tmp_path, bench):
    robots = lanes(3, 4.0)
    robots[2]["limits"] = {"speed_mps": 0.2}  # while it drives, a slow start of the others is no deadlock
    faults = [{"kind": "kill", "robots": [1], "start_s": 0.5, "duration_s": 1.0}]
    scenario = straight(tmp_path / "lanes.yaml", robots, faults=faults)
    run = bench("out", "run", scenario, *REALTIME_WITH_RESTARTS)
    run.reach(10)
    run.kill("agent", "2")
    assert run.end() == 0, run.complained
    run.leaves_nothing()
    assert (run.summary["verdict"], run.summary["restarts"]) == ("arrived", {"robot-1": 1, "robot-2": 1})
    assert "started again" in run.told
    assert run.log("robot-2").count("joined") == 2, "its log goes on"
    assert [len(run.begun(robot)) for robot in ("1", "2", "3")] == [2, 2, 1]


@pytest.mark.slow
@pytest.mark.parametrize("how", ["by itself", "by a fault"])
def test_a_world_that_is_started_again_begins_a_new_epoch_with_all_robots(tmp_path, bench, process, how):
    faults = [{"kind": "restart-world", "start_s": 0.6, "duration_s": 0.5}] if how == "by a fault" else []
    scenario = straight(tmp_path / "lanes.yaml", lanes(2, 2.0), faults=faults)
    run = bench("out", "run", scenario, "--restart", "on-failure")
    if not faults:
        run.reach(5)
        run.kill("world")
    assert run.end() == 0, run.complained
    run.leaves_nothing()
    messages = [message for _, message in recorded(run.out)]
    epochs = [epoch for epoch, _ in itertools.groupby(message.epoch for message in messages)]
    assert len(epochs) == 2, "what belongs to one world is not mixed with the other's"
    assert [scene.epoch for scene in run.messages(PublicScene)] == epochs
    last = [message for message in messages if message.epoch == epochs[1]]
    assert isinstance(last[0], PublicScene)
    truths = [message for message in last if isinstance(message, Truth)]
    assert [truth.step for truth in truths] == list(range(len(truths))), "nothing is missing"
    for robot in ("1", "2"):
        answered = [each.step for each in last if isinstance(each, Command) and each.robot == robot]
        assert answered == list(range(len(truths) - 1))
    summary = run.summary
    assert summary["restarts"] == {"world": 1}
    assert summary["refused"] == truths[-1].refused == {}, "no robot answered the former world"
    assert (summary["steps"], summary["deadline_misses"]) == (truths[-1].step, 0)
    assert {robot["id"]: robot["arrived_s"] for robot in summary["robots"]} == {
        name: robot.arrived_s for name, robot in truths[-1].robots.items()
    }
    if not faults:
        audit = process("audit", "audit", run.out)
        assert audit.end() == 2
        assert "the world was started again" in audit.complained


@pytest.mark.slow
def test_a_robot_that_is_stopped_and_a_pause_of_the_whole_machine_cost_steps_but_no_memory(tmp_path, bench):
    faults = [
        {"kind": "freeze", "robots": [2], "start_s": 0.5, "duration_s": 0.7},
        {"kind": "kill", "robots": [3], "start_s": 0.5},
        {"kind": "pause", "start_s": 2.0, "duration_s": 2.5},
        {"kind": "loss", "robots": [1], "start_s": NEVER_S, "rate": 1.0},  # its relay pauses too
    ]
    run = bench("out", "run", straight(tmp_path / "lanes.yaml", lanes(3, 4.0), faults=faults))
    assert run.end() == 1, run.complained
    run.leaves_nothing()
    assert run.complained == "", "what a fault kills is no failure of the run"
    assert run.summary["restarts"] == {}
    assert [len(run.begun(robot)) for robot in ("1", "2", "3")] == [1, 1, 1]
    missed = run.missed("2")
    assert len(missed) >= 2
    assert all(step >= 20 for step in run.missed("1")), "until the pause"
    arrived_s = {robot["id"]: robot["arrived_s"] for robot in run.summary["robots"]}
    assert None not in (arrived_s["1"], arrived_s["2"])
    first = run.missed("3")[0]
    assert first >= 5
    brakes(run.true("3"), range(first + 1, first + 20))
    steps = [truth.step for truth in run.messages(Truth)]
    assert steps[-1] - len(steps) < 5, "the world waits for its robots and for the bench"
