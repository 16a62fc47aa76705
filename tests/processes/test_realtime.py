"""Real time: steps keep their distance, whoever is late misses a step, and nothing piles up."""

import itertools
import os
import re
import signal
from queue import SimpleQueue

import pytest
from mcap.reader import make_reader
from process_helpers import (
    PATIENCE_S,
    applied,
    audited,
    brakes,
    lanes,
    numbers,
    recorded,
    write_scenario,
)

from protocol.codec import decode
from protocol.messages import Command, Mind, Truth
from protocol.vehicle import Limits

REALTIME = ("--clock", "realtime")


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


def test_a_robot_that_is_held_up_brakes_at_once_and_goes_on_with_the_newest_pose(tmp_path, bench):
    """They speed up so gradually that every step has an input of its own. Long steps suit a busy machine."""
    limits, step_s = Limits(jerk_mps3=0.1), 0.2
    robots = lanes(2, 900.0, limits={"jerk_mps3": limits.jerk_mps3})
    scenario = write_scenario(
        tmp_path / "gradual.yaml", robots, area={"x_max_m": 1000.0}, time_limit_s=1000.0, step_s=step_s
    )
    run = bench("out", "run", scenario, *REALTIME)
    held, last = hold_up(run, "2", 10)
    run.reach(last + 3)  # and not so long that its connection is taken for lost
    os.kill(held, signal.SIGCONT)
    run.reach(last + 10)
    run.signal(signal.SIGINT)
    assert run.end() == 1, run.complained

    answers = {
        robot: [m for key, m in recorded(run.out) if key == f"command/{robot}"] for robot in ("1", "2")
    }
    commands = {command.step: command for command in answers["2"]}
    thoughts = [mind.step for mind in run.messages(Mind) if mind.robot == "2"]
    true, missed = run.true("2"), run.missed("2")
    gap = list(itertools.takewhile(lambda step: step in missed, itertools.count(last + 1)))
    assert len(gap) >= 2

    brakes(true, gap, limits, step_s)
    assert len(set(thoughts) & set(gap)) < len(gap), "a backlog is not worked through"
    assert not commands.keys() & set(gap), "what comes too late is not said"
    # It knows what was driven meanwhile: its next command can be reached from there.
    back = gap[-1] + 1
    assert applied(true[back + 1]) == pytest.approx(commands[back].input)
    assert len(answers["1"]) > len(commands), "the other was not held up"

    # Such short-sighted robots would be through in lock-step in a part of this time; a busy machine may tell
    # the bench of the first step late.
    summary, times_s = run.summary, truth_times_s(run)
    assert summary["clock"] == "realtime"
    assert times_s[-1] - times_s[0] > 0.8 * summary["steps"] * step_s
    for robot in summary["robots"]:
        assert all(former.step < later.step for former, later in itertools.pairwise(answers[robot["id"]]))
        assert robot["deadline_misses"] >= summary["steps"] - len(answers[robot["id"]])
    assert summary["deadline_misses"] == sum(robot["deadline_misses"] for robot in summary["robots"])


@pytest.mark.slow
def test_robots_too_slow_for_most_steps_think_on_do_not_say_what_comes_too_late_and_can_be_repeated(
    tmp_path, bench, process
):
    """With steps of a millisecond, the reference solver cannot keep up."""
    scenario = write_scenario(tmp_path / "hasty.yaml", lanes(2, 9.0), step_s=0.001, time_limit_s=1.0)
    run = bench("out", "run", scenario, *REALTIME, "--solver", "reference")
    assert run.end() == 1, run.complained
    report = audited(process, run.out, tmp_path)
    seen, minds, commands = (numbers(report, kind) for kind in ("observations", "minds", "commands"))
    for robot in ("1", "2"):
        assert minds[robot] < seen[robot]
        [late] = re.findall(r"late_decisions=(\d+)", run.log(f"robot-{robot}"))
        assert 0 < minds[robot] - commands[robot] <= int(late), "the bench leaves before the robot"


@pytest.mark.slow
def test_a_run_follows_though_the_clock_cut_decisions_short(tmp_path, bench, process):
    run = bench("out", "run", "2-crossing", *REALTIME, "--budget-ms", 2)
    assert run.end() in (0, 1), run.complained
    minds = run.messages(Mind)
    assert any(mind.cut_short_at is not None for mind in minds)
    assert sum(numbers(audited(process, run.out, tmp_path), "minds").values()) == len(minds)
