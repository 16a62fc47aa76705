"""Processes that die: the run says which, and how, and ends all others."""

import json
import os
import signal

from process_helpers import endless, lanes, recorded, until, write_scenario


def killed(run, pid):
    """Kill a process of a run; return all that it had."""
    children = run.children()
    os.kill(pid, signal.SIGKILL)
    return children


def test_when_a_robot_dies_the_others_go_on_and_it_is_named(tmp_path, bench):
    scenario = write_scenario(
        tmp_path / "lanes.yaml",
        lanes(3, 1.0),
        horizons={"prediction_steps": 12, "estimation_steps": 3},
        time_limit_s=4.0,
    )
    run = bench("out", "run", scenario)
    run.reach(3)
    children = killed(run, run.pid("agent", "2"))
    assert run.end() == 3
    run.leaves_nothing(children)
    assert "robot-2 was killed by signal 9" in run.complained
    assert "joined" in run.complained, "the end of its log is shown"
    assert "robot-1" not in run.complained
    summary = json.loads((run.out / "summary.json").read_text())
    assert summary["verdict"] == "timeout"
    arrived_s = {robot["id"]: robot["arrived_s"] for robot in summary["robots"]}
    assert arrived_s["1"] is not None
    assert arrived_s["1"] == arrived_s["3"]
    assert arrived_s["2"] is None
    assert summary["robots"][1]["deadline_misses"] > 0


def test_when_a_robot_dies_before_the_first_step_the_run_is_given_up(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    until(lambda: len(run.children()) == 3, "the last robot")
    children = killed(run, run.pid("agent", "2"))
    assert run.end() == 3
    run.leaves_nothing(children)
    assert "robot-2 was killed by signal 9" in run.complained
    assert "Failed before the first step." in run.told


def test_when_the_world_dies_the_run_has_failed_and_keeps_what_was_recorded(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    run.reach(3)
    children = killed(run, run.pid("world"))
    assert run.end() == 3
    run.leaves_nothing(children)
    assert "world was killed by signal 9" in run.complained
    assert "all robots present" in run.complained, "the end of its log is shown"
    assert "Traceback" not in run.complained
    summary = json.loads((run.out / "summary.json").read_text())
    assert (summary["verdict"], summary["duration_s"]) == ("failed", None)
    assert summary["steps"] >= 3
    assert recorded(run.out)
