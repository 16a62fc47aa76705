"""Faults of links and minds in real processes: the same as in virtual time, bit for bit."""

import pytest
import yaml
from process_helpers import until, write_scenario

from protocol.messages import PublicScene, Truth


def crossing(path, faults, time_limit_s, length_m=4.0):
    robots = [
        {"id": 1, "start": {"x_m": 0.0, "y_m": 0.0}, "goal": {"x_m": length_m, "y_m": 3.0}},
        {"id": 2, "start": {"x_m": 0.0, "y_m": 3.0}, "goal": {"x_m": length_m, "y_m": 0.0}},
    ]
    horizons = {"prediction_steps": 12, "estimation_steps": 5}
    return write_scenario(path, robots, horizons=horizons, time_limit_s=time_limit_s, faults=faults)


def driven(run):
    """What was driven; at which step a superfluous command is noticed and refused depends on its way."""
    assert run.end() in (0, 1), run.complained
    same = {"epoch": 0, "refused": {}}
    return [truth.model_copy(update=same).model_dump_json() for truth in run.messages(Truth)]


def drives_as_in_virtual_time(bench, scenario, *options, policy="--policy"):
    """Check it; return the run in processes."""
    run = bench("run", "run", scenario, *options, policy)
    assert driven(run) == driven(bench("virtual", "simulate", scenario, *options))
    return run


def test_loss_and_garbage_befall_processes_as_they_do_in_virtual_time(tmp_path, bench):
    faults = [
        {"kind": "loss", "rate": 0.3, "start_s": 0.3},
        {"kind": "garbage", "rate": 0.2},
        {"kind": "delay", "steps": 2, "start_s": 0.5, "duration_s": 0.5},
        {"kind": "duplication", "rate": 0.3},
        {"kind": "command-loss", "rate": 0.2},
        {"kind": "ignores", "start_s": 0.8},
    ]
    scenario, file = crossing(tmp_path / "calm.yaml", [], 1.5), tmp_path / "faults.yaml"
    file.write_text(yaml.safe_dump({"faults": [{**fault, "robots": [1]} for fault in faults]}))
    run = drives_as_in_virtual_time(bench, scenario, "--faults", file)
    assert run.missed("1")
    assert run.missed("2") == []
    assert "a link for this epoch" in run.log("relay-1")
    assert run.log("relay-2") == "", "only who has faults has a relay"


OTHERS = {
    "observations and commands": [
        {"kind": "command-delay", "robots": [1], "steps": 2, "rate": 0.3},
        {"kind": "command-excess", "robots": [2], "rate": 0.3},
        {"kind": "command-duplication", "rate": 0.2},
        {"kind": "jitter", "robots": [1], "steps": 3},
        {"kind": "reordering", "robots": [2], "rate": 0.3},
        {"kind": "ghost", "robots": [1], "x_m": 2.0, "y_m": 1.0},
        {"kind": "jump", "robots": [2], "seen": 1, "distance_m": 1.0, "rate": 0.2},
        {"kind": "nan", "robots": [1], "rate": 0.1},
        {"kind": "wrong-version", "robots": [2], "rate": 0.1},
        {"kind": "wrong-epoch", "robots": [1], "rate": 0.05},
        {"kind": "slow", "robots": [2], "rate": 0.2},
    ],
    "minds and company": [
        {"kind": "stops", "robots": [1], "start_s": 1.5, "duration_s": 0.5},
        {"kind": "weak", "robots": [2]},
        {"kind": "solver-failure", "robots": [1], "rate": 0.3},
        {"kind": "infeasible", "robots": [2], "start_s": 0.5, "duration_s": 0.3},
        {"kind": "clock-step", "offset_s": -1e6, "start_s": 0.5},
        {"kind": "arrives-late", "robots": [1], "start_s": 0.5},
        {"kind": "leaves", "robots": [2], "start_s": 1.0, "duration_s": 0.5},
        {"kind": "chases", "robots": [2], "seen": 1, "start_s": 2.1},
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize(("what", "policy"), list(zip(OTHERS, ("--policy", "--no-policy"), strict=True)))
def test_other_faults_befall_processes_as_they_do_in_virtual_time(tmp_path, bench, what, policy):
    drives_as_in_virtual_time(bench, crossing(tmp_path / "some.yaml", OTHERS[what], 3.0), policy=policy)


@pytest.mark.slow
def test_a_relay_survives_the_restart_of_its_world_and_of_its_robot(tmp_path, bench):
    faults = [
        {"kind": "loss", "robots": [1], "rate": 0.2},
        {"kind": "restart-world", "start_s": 1.0, "duration_s": 0.5},
    ]
    scenario = crossing(tmp_path / "both.yaml", faults, 120.0, length_m=9.0)  # or a slow start is a deadlock
    run = bench("out", "run", scenario, "--clock", "realtime", "--restart", "on-failure")
    until(lambda: run.log("world").count("all robots present") == 2, "the second world")
    run.kill("agent", "1")
    assert run.end() == 0, run.complained
    assert run.log("relay-1").count("a link for this epoch") == 2
    assert run.log("robot-1").count("joined") >= 2
    assert len(run.messages(PublicScene)) == 2
    end = run.messages(Truth)[-1]
    assert end.robots["1"].deadline_misses > end.robots["2"].deadline_misses
