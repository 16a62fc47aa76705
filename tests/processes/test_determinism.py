"""The same experiment drives the same way, in processes and in virtual time."""

import os
import subprocess
import sys
from contextlib import contextmanager

import pytest
from process_helpers import bundled_with, recorded

from protocol.messages import Mind, Timings


def drive(bench, name, *arguments):
    """The recorded messages of a whole run by key and step, without what differs from run to run."""
    process = bench(name, *arguments)
    assert process.end() in (0, 1), process.complained
    messages = {}
    for key, message in recorded(process.out):
        same = message.model_copy(update={"epoch": 0})
        if isinstance(message, Mind):
            same = same.model_copy(update={"timings_ms": Timings()})
        place = (key, getattr(message, "step", None))
        assert place not in messages, f"{place} was recorded twice"
        messages[place] = same.model_dump_json()
    return messages


def kinds(messages):
    return {key.partition("/")[0] for key, _ in messages}


# Long enough for the inverse problem to begin; four robots have shorter horizons, which makes the test fast.
@pytest.mark.parametrize(
    ("name", "steps", "rules"),
    [
        ("2-crossing", 20, {}),
        ("4-crossing", 12, {"horizons": {"prediction_steps": 15, "estimation_steps": 8}}),
    ],
    ids=["2-crossing", "4-crossing"],
)
def test_processes_in_lock_step_and_virtual_time_agree_bit_for_bit(tmp_path, bench, name, steps, rules):
    scenario = bundled_with(tmp_path / "scenario.yaml", name, time_limit_s=0.1 * steps, **rules)
    processes = drive(bench, "run", "run", scenario)
    assert kinds(processes) == {"scene", "pose", "truth", "mind", "command"}
    assert max(step for key, step in processes if key == "truth") == steps
    assert processes == drive(bench, "simulate", "simulate", scenario)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["2-crossing", "4-crossing"])
def test_whole_runs_in_processes_and_in_virtual_time_agree_bit_for_bit(bench, name):
    processes = drive(bench, "run", "run", name)
    assert len(processes) > 100
    assert processes == drive(bench, "simulate", "simulate", name)


@contextmanager
def busy_machine():
    """Other processes want each core several times over."""
    burners = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * (os.cpu_count() or 1))
    ]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


@pytest.mark.slow
def test_a_recording_is_complete_although_the_machine_is_busy(bench):
    """As in virtual time, which loses nothing."""
    with busy_machine():
        processes = drive(bench, "run", "run", "8a")
    assert processes.keys() == drive(bench, "simulate", "simulate", "8a").keys()


@pytest.mark.slow
def test_noise_and_delay_follow_the_seed_and_nothing_else(tmp_path, bench):
    scenario = bundled_with(
        tmp_path / "scenario.yaml",
        "2-crossing",
        time_limit_s=0.8,
        horizons={"prediction_steps": 8, "estimation_steps": 4},
        sensing={"position_noise_m": 0.02, "heading_noise_rad": 0.01, "dropout": 0.1, "delay_steps": 2},
    )
    one, again = (drive(bench, name, "run", scenario, "--seed", 3) for name in ("one", "again"))
    virtual = drive(bench, "virtual", "simulate", scenario, "--seed", 3)
    other = drive(bench, "other", "simulate", scenario, "--seed", 4)
    assert one == again == virtual
    assert other["pose/1", 0] != virtual["pose/1", 0]
    assert other["truth", 8] != virtual["truth", 8], "noise reaches the decisions"
