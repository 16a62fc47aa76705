"""Processes that end are started again where that is asked for, and none outlives the bench."""

import itertools
import json
import os
import signal

import pytest
from process_helpers import endless, ends_all, lanes, recorded, write_scenario

from protocol.messages import Command, Mind, PublicScene, Truth
from protocol.vehicle import Input, Limits, braking_input

FAR_SIGHTED = {"prediction_steps": 12, "estimation_steps": 3}


def summary_of(run):
    return json.loads((run.out / "summary.json").read_text())


def kill(run, pid):
    children = run.children()
    os.kill(pid, signal.SIGKILL)
    return children


def test_no_process_outlives_a_bench_that_is_killed_not_even_one_that_is_stopped(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    run.reach(1)
    children = run.children()
    assert len(children) == 3
    os.kill(run.pid("agent", "2"), signal.SIGSTOP)
    run.signal(signal.SIGKILL)
    assert run.end() == -signal.SIGKILL
    ends_all(children)


@pytest.mark.slow
def test_a_robot_that_fails_is_started_again_and_drives_on_to_its_goal(tmp_path, bench):
    robots = lanes(2, 9.0)  # while the other one drives, a slow start is no deadlock
    scenario = write_scenario(tmp_path / "lanes.yaml", robots, horizons=FAR_SIGHTED)
    run = bench("out", "run", scenario, "--restart", "on-failure", "--clock", "realtime")
    run.reach(10)
    kill(run, run.pid("agent", "2"))
    assert run.end() == 0, run.complained
    run.leaves_nothing({})
    summary = summary_of(run)
    assert (summary["verdict"], summary["restarts"]) == ("arrived", {"robot-2": 1})
    assert "started again" in run.told
    assert run.log("robot-2").count("joined") == 2, "its log goes on"
    thoughts = [message for _, message in recorded(run.out) if isinstance(message, Mind)]
    begun = [mind.step for mind in thoughts if mind.robot == "2" and mind.decision == 0]
    assert len(begun) == 2, "it has forgotten everything in between"
    assert len([mind for mind in thoughts if mind.robot == "1" and mind.decision == 0]) == 1


@pytest.mark.slow
def test_a_world_that_fails_is_started_again_and_its_robots_come_back_by_themselves(tmp_path, bench, process):
    scenario = write_scenario(tmp_path / "lanes.yaml", lanes(2, 2.0), horizons=FAR_SIGHTED)
    run = bench("out", "run", scenario, "--restart", "on-failure")
    run.reach(5)
    kill(run, run.pid("world"))
    assert run.end() == 0, run.complained
    run.leaves_nothing({})
    messages = recorded(run.out)
    epochs = [epoch for epoch, _ in itertools.groupby(message.epoch for _, message in messages)]
    assert len(epochs) == 2, "what belongs to one world is not mixed with the other's"
    scenes = [message.epoch for _, message in messages if isinstance(message, PublicScene)]
    assert scenes == epochs
    last = [message for _, message in messages if message.epoch == epochs[1]]
    assert isinstance(last[0], PublicScene)
    truths = [message for message in last if isinstance(message, Truth)]
    assert [truth.step for truth in truths] == list(range(len(truths))), "nothing is missing"
    for robot in ("1", "2"):
        answered = [each.step for each in last if isinstance(each, Command) and each.robot == robot]
        assert answered == list(range(len(truths) - 1))
    audit = process("audit", "audit", run.out)
    assert audit.end() == 2
    assert "the world was started again" in audit.complained
    summary = summary_of(run)
    assert summary["restarts"] == {"world": 1}
    assert summary["refused"] == truths[-1].refused == {}, "no robot answered the former world"
    assert summary["steps"] == truths[-1].step
    assert summary["deadline_misses"] == 0
    assert {robot["id"]: robot["arrived_s"] for robot in summary["robots"]} == {
        name: robot.arrived_s for name, robot in truths[-1].robots.items()
    }


@pytest.mark.slow
@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_robot_that_is_killed_drives_its_plan_for_a_step_and_then_brakes(tmp_path, bench, clock):
    scenario = write_scenario(tmp_path / "lanes.yaml", lanes(2, 9.0), horizons=FAR_SIGHTED, time_limit_s=8.0)
    run = bench("out", "run", scenario, "--clock", clock)
    run.reach(10)
    kill(run, run.pid("agent", "2"))
    assert run.end() == 3, run.complained
    messages = [message for _, message in recorded(run.out)]
    commands = {each.step: each for each in messages if isinstance(each, Command) and each.robot == "2"}
    true = {each.step: each.robots["2"] for each in messages if isinstance(each, Truth)}
    last, end = max(commands), max(true)
    assert applied(true[last + 2]) == pytest.approx(commands[last].then)
    assert last + 2 < end
    for step in range(last + 2, end):
        former = true[step]
        braking = braking_input(Limits(), applied(former), former.state.speed_mps, 0.1)
        assert applied(true[step + 1]) == pytest.approx(braking)
    assert abs(true[end].state.speed_mps) < 1e-9
    assert end == 80, "the others drive on"


def applied(robot):
    """What led to a truth."""
    return Input(robot.turn_rate_radps, robot.acceleration_mps2)
