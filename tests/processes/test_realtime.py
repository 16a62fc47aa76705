"""Real time: steps keep their distance, whoever is late misses a step, and nothing piles up."""

import itertools
import json
import os
import signal

from mcap.reader import make_reader
from process_helpers import SHORT_SIGHTED, bundled_with, endless, recorded

from protocol.messages import Truth


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


def test_steps_last_as_long_as_they_should_and_misses_are_counted(tmp_path, bench):
    scenario = bundled_with(
        tmp_path / "scenario.yaml", "2-crossing", horizons=SHORT_SIGHTED, time_limit_s=3.0
    )
    run = bench("out", "run", scenario, "--clock", "realtime")
    assert run.end() == 1
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


def test_a_robot_that_was_held_up_goes_on_with_the_newest_observation(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2), "--clock", "realtime")
    run.reach(5)
    held = run.pid("agent", "2")
    os.kill(held, signal.SIGSTOP)
    run.reach(14)
    os.kill(held, signal.SIGCONT)
    run.reach(24)
    run.signal(signal.SIGINT)
    assert run.end() == 1
    answered = answered_steps(run, "2")
    assert all(former < later for former, later in itertools.pairwise(answered))
    assert max(answered) > 14, "it takes part again"
    gap = max(later - former for former, later in itertools.pairwise(answered))
    assert gap >= 5, "what it could not see in time is not answered later"
    robots = {robot["id"]: robot for robot in summary_of(run)["robots"]}
    assert robots["2"]["deadline_misses"] >= gap - 1
    assert len(answered_steps(run, "1")) > len(answered), "the other was not held up"
