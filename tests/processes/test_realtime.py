"""Real time: steps keep their distance, whoever is late misses a step, and nothing piles up."""

import itertools
import json
import os
import re
import signal
from queue import SimpleQueue

import pytest
from mcap.reader import make_reader
from process_helpers import PATIENCE_S, SHORT_SIGHTED, bundled_with, lanes, recorded, write_scenario

from protocol.codec import decode
from protocol.messages import Command, Truth
from protocol.vehicle import Input, Limits, braking_input


def summary_of(run):
    return json.loads((run.out / "summary.json").read_text())


def answered_steps(run, robot):
    """Steps that a robot's commands answer, in their order."""
    return [message.step for key, message in recorded(run.out) if key == f"command/{robot}"]


def truth_times_s(run):
    """When the bench received each truth."""
    with (run.out / "run.mcap").open("rb") as file:
        messages = make_reader(file).iter_messages(log_time_order=False)
        return [record.log_time / 1e9 for schema, _, record in messages if schema.name == Truth.__name__]


def hold_up(run, robot, step):
    """Stop a robot's process as soon as it has answered this step or a later one: no answer is under way.

    Returns:
        The process id, and the step that it has answered last.
    """
    run.logs("world", "all robots present")
    pid, last = run.pid("agent", robot), SimpleQueue()

    def look(sample):
        answered = decode(Command, sample.payload.to_bytes()).step
        if last.empty() and answered >= step:
            os.kill(pid, signal.SIGSTOP)
            last.put(answered)

    with run.listening() as session:
        _commands = session.declare_subscriber(run.keys().command(robot), look)
        answered = last.get(timeout=PATIENCE_S)
    return pid, answered


def applied(robot):
    """What led to a truth."""
    return Input(robot.turn_rate_radps, robot.acceleration_mps2)


def test_steps_last_as_long_as_they_should_and_misses_are_counted(tmp_path, bench):
    scenario = bundled_with(
        tmp_path / "scenario.yaml", "2-crossing", horizons=SHORT_SIGHTED, time_limit_s=3.0
    )
    run = bench("out", "run", scenario, "--clock", "realtime")
    assert run.end() == 1, run.complained
    summary = summary_of(run)
    assert (summary["clock"], summary["verdict"], summary["steps"]) == ("realtime", "timeout", 30)
    # Such short-sighted robots would be through in lock-step in a part of this time; a busy machine may tell
    # the bench of the first step late.
    times_s = truth_times_s(run)
    assert times_s[-1] - times_s[0] > 0.8 * summary["steps"] * 0.1
    for robot in summary["robots"]:
        answered = answered_steps(run, robot["id"])
        assert all(former < later for former, later in itertools.pairwise(answered))
        assert robot["deadline_misses"] >= summary["steps"] - len(answered)
    assert summary["deadline_misses"] == sum(robot["deadline_misses"] for robot in summary["robots"])


def test_a_robot_that_is_held_up_drives_its_plan_then_brakes_and_goes_on_with_the_newest_pose(
    tmp_path, bench
):
    """They speed up so gradually that every step has an input of its own. Long steps suit a busy machine."""
    limits, step_s = Limits(jerk_mps3=0.1), 0.2
    robots = lanes(2, 900.0, limits={"jerk_mps3": limits.jerk_mps3})
    scenario = write_scenario(
        tmp_path / "gradual.yaml", robots, area={"x_max_m": 1000.0}, time_limit_s=1000.0, step_s=step_s
    )
    run = bench("out", "run", scenario, "--clock", "realtime")
    held, last = hold_up(run, "2", 10)
    run.reach(last + 3)  # and not so long that its connection is taken for lost
    os.kill(held, signal.SIGCONT)
    run.reach(last + 10)
    run.signal(signal.SIGINT)
    assert run.end() == 1, run.complained

    messages = recorded(run.out)
    commands = {message.step: message for key, message in messages if key == "command/2"}
    thoughts = [message.step for key, message in messages if key == "mind/2"]
    truths = [message for _, message in messages if isinstance(message, Truth)]
    true = {truth.step: truth.robots["2"] for truth in truths}
    missed = [
        step for step in range(max(true)) if true[step + 1].deadline_misses > true[step].deadline_misses
    ]
    gap = list(itertools.takewhile(lambda step: step in missed, itertools.count(last + 1)))
    assert len(gap) >= 2

    planned = commands[last].then
    assert planned not in (None, commands[last].input)
    assert applied(true[last + 2]) == pytest.approx(planned)
    for step in gap[1:]:
        braking = braking_input(limits, applied(true[step]), true[step].state.speed_mps, step_s)
        assert applied(true[step + 1]) == pytest.approx(braking)
    assert len(set(thoughts) & set(gap)) < len(gap), "a backlog is not worked through"
    assert not commands.keys() & set(gap), "what comes too late is not said"
    # It knows what was driven meanwhile: its next command can be reached from there.
    back = gap[-1] + 1
    assert applied(true[back + 1]) == pytest.approx(commands[back].input)
    assert len(answered_steps(run, "1")) > len(commands), "the other was not held up"


def test_a_robot_that_is_too_slow_thinks_on_but_does_not_say_what_comes_too_late(tmp_path, bench):
    """With steps of a millisecond, the reference solver cannot keep up."""
    scenario = write_scenario(
        tmp_path / "hasty.yaml",
        lanes(2, 9.0),
        horizons={"prediction_steps": 30, "estimation_steps": 15},
        step_s=0.001,
        time_limit_s=2.0,
    )
    run = bench("out", "run", scenario, "--clock", "realtime", "--solver", "reference")
    assert run.end() == 1, run.complained
    keys = [key for key, _ in recorded(run.out)]
    withheld = keys.count("mind/1") - keys.count("command/1")
    [late] = re.findall(r"late_decisions=(\d+)", run.log("robot-1"))
    assert 0 < withheld <= int(late), "the bench leaves before the robot"
