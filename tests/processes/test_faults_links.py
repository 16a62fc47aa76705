"""Faults of links and minds in real processes: the same as in virtual time, bit for bit."""

import pytest
import yaml
from process_helpers import recorded, until

from protocol.messages import Mind, PublicScene, Timings, Truth

LATER_THAN_EVER_S = 1000.0


def crossing(path, faults, time_limit_s, length_m=4.0):
    content = {
        "name": path.stem,
        "horizons": {"prediction_steps": 12, "estimation_steps": 5},
        "time_limit_s": time_limit_s,
        "robots": [
            {"id": 1, "start": {"x_m": 0.0, "y_m": 0.0}, "goal": {"x_m": length_m, "y_m": 3.0}},
            {"id": 2, "start": {"x_m": 0.0, "y_m": 3.0}, "goal": {"x_m": length_m, "y_m": 0.0}},
        ],
        "faults": faults,
    }
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def told(process):
    """The messages of a run, without what differs from run to run."""
    assert process.end() in (0, 1), process.complained
    same = []
    for key, message in recorded(process.out):
        plain = message.model_copy(update={"epoch": 0})
        if isinstance(message, Mind):
            plain = plain.model_copy(update={"timings_ms": Timings()})
        same.append((key, plain.model_dump_json()))
    return same


def truths(process):
    """What was driven; at which step a superfluous command is noticed and refused depends on its way."""
    assert process.end() in (0, 1), process.complained
    return [
        message.model_copy(update={"epoch": 0, "refused": {}}).model_dump_json()
        for key, message in recorded(process.out)
        if key == "truth"
    ]


def drives_as_in_virtual_time(bench, scenario, *options):
    """Check it; return what was driven."""
    processes = truths(bench("run", "run", scenario, *options))
    assert processes == truths(bench("simulate", "simulate", scenario, *options))
    return processes


def test_loss_and_garbage_befall_processes_as_they_do_in_virtual_time(tmp_path, bench):
    faults = [
        {"kind": "loss", "robots": [1], "rate": 0.3, "start_s": 0.3},
        {"kind": "garbage", "robots": [1], "rate": 0.2},
        {"kind": "delay", "robots": [2], "steps": 2, "start_s": 0.5, "duration_s": 0.5},
        {"kind": "duplication", "rate": 0.3},
        {"kind": "command-loss", "rate": 0.2},
        {"kind": "ignores", "robots": [2], "start_s": 0.8},
    ]
    scenario, file = crossing(tmp_path / "calm.yaml", [], 1.5), tmp_path / "faults.yaml"
    file.write_text(yaml.safe_dump({"faults": faults}), encoding="utf-8")
    disturbed = drives_as_in_virtual_time(bench, scenario, "--faults", file)
    calm = truths(bench("calm", "simulate", scenario))
    assert len(disturbed) == len(calm)
    assert disturbed != calm, "the faults change what is driven"


OTHERS = {
    "commands": [
        {"kind": "command-delay", "robots": [1], "steps": 2, "rate": 0.3},
        {"kind": "command-excess", "robots": [2], "rate": 0.3},
        {"kind": "command-duplication", "rate": 0.2},
    ],
    "sensing": [
        {"kind": "jitter", "robots": [1], "steps": 3},
        {"kind": "reordering", "robots": [2], "rate": 0.3},
        {"kind": "ghost", "robots": [1], "x_m": 2.0, "y_m": 1.0},
        {"kind": "jump", "robots": [2], "seen": 1, "distance_m": 1.0, "rate": 0.2},
        {"kind": "nan", "robots": [1], "rate": 0.1},
        {"kind": "wrong-version", "robots": [2], "rate": 0.1},
        {"kind": "wrong-epoch", "robots": [1], "rate": 0.05},
        {"kind": "slow", "robots": [2], "rate": 0.2},
    ],
    "minds": [
        {"kind": "stops", "robots": [1], "start_s": 1.5, "duration_s": 0.5},
        {"kind": "weak", "robots": [2]},
        {"kind": "solver-failure", "robots": [1], "rate": 0.3},
        {"kind": "infeasible", "robots": [2], "start_s": 1.0, "duration_s": 0.3},
        {"kind": "clock-step", "offset_s": -1e6, "start_s": 0.5},
    ],
    "company": [
        {"kind": "arrives-late", "robots": [1], "start_s": 0.5},
        {"kind": "leaves", "robots": [2], "start_s": 1.0, "duration_s": 0.5},
        {"kind": "chases", "robots": [2], "seen": 1, "start_s": 1.6},
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("what", OTHERS)
def test_other_faults_befall_processes_as_they_do_in_virtual_time(tmp_path, bench, what):
    drives_as_in_virtual_time(bench, crossing(tmp_path / f"{what}.yaml", OTHERS[what], 3.0))


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["--policy", "--no-policy"])
def test_a_relay_on_which_no_fault_strikes_changes_nothing(tmp_path, bench, policy):
    nothing = [{"kind": "loss", "robots": [1], "rate": 1.0, "start_s": LATER_THAN_EVER_S}]
    relayed = bench("relayed", "run", crossing(tmp_path / "one.yaml", nothing, 1.5), policy)
    plain = bench("plain", "run", crossing(tmp_path / "other.yaml", [], 1.5), policy)
    assert set(told(relayed)) == set(told(plain))
    assert "a link for this epoch" in relayed.log("relay-1")
    assert relayed.log("relay-2") == "", "only who has faults has a relay"


@pytest.mark.slow
def test_a_relay_survives_the_restart_of_its_world_and_of_its_robot(tmp_path, bench):
    faults = [
        {"kind": "loss", "robots": [1], "rate": 0.2},
        {"kind": "restart-world", "start_s": 1.0, "duration_s": 0.5},
    ]
    run = bench(
        "out",
        "run",
        crossing(tmp_path / "both.yaml", faults, 120.0, length_m=9.0),  # or a slow start is a deadlock
        "--clock",
        "realtime",
        "--restart",
        "on-failure",
    )
    until(lambda: run.log("world").count("all robots present") == 2, "the second world")
    run.kill("agent", "1")
    assert run.end() == 0, run.complained
    assert run.log("relay-1").count("a link for this epoch") == 2
    assert run.log("robot-1").count("joined") >= 2
    messages = recorded(run.out)
    assert len([message for _, message in messages if isinstance(message, PublicScene)]) == 2
    end = [message for _, message in messages if isinstance(message, Truth)][-1]
    assert end.robots["1"].deadline_misses > end.robots["2"].deadline_misses
