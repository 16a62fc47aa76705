"""What the check of a device says of its clocks, its kernels and its speed, and how it says it."""

import json
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from checking_helpers import device
from typer.testing import CliRunner

import agent.check.device
from agent.check.device import check_kernels, check_steady_clock, check_wall_clock, is_synchronised
from agent.check.findings import Finding
from agent.check.speed import FEWEST, Crossing, Taken, judged, measure, scene_of
from agent.cli import app
from agent.solve.compiled import processor
from protocol.scene import Horizons
from protocol.vehicle import STANDSTILL

NOW = datetime(2026, 6, 1, 12, 0, tzinfo=UTC)


@pytest.mark.parametrize(
    ("now", "synchronised", "state"),
    [
        (NOW, True, "ok"),
        (NOW, None, "ok"),
        (NOW, False, "warning"),
        (NOW - timedelta(days=400), True, "failed"),
    ],
)
def test_the_time_of_day_is_kept_right_and_not_before_the_installation(now, synchronised, state):
    told = check_wall_clock(now, NOW - timedelta(days=1), synchronised)
    assert told.state == state
    assert "2026" in told.found or "2025" in told.found


def test_the_kernel_is_asked_and_nothing_is_set():
    assert is_synchronised() in (True, False, None)


@pytest.mark.parametrize(
    ("passes_s", "state"), [(0.05, "ok"), (0.0, "failed"), (-1.0, "failed"), (60.0, "failed")]
)
def test_the_steady_clock_advances(passes_s, state):
    times = iter([100.0, 100.0 + passes_s])
    assert check_steady_clock(lambda: next(times), lambda _: None).state == state


def test_the_real_steady_clock_is_one():
    assert check_steady_clock().state == "ok"


def test_kernels_are_there_or_can_be_made_or_cannot(tmp_path):
    folder, name = tmp_path / "kernels-1", processor()
    assert check_kernels(True, folder, name, [tmp_path]).state == "ok"
    missing = check_kernels(False, folder, name, [tmp_path])
    assert missing.state == "failed"
    assert missing.remedy.endswith("-m agent.process.warm")
    assert "is for others" not in missing.found
    (tmp_path / "kernels-2").mkdir()
    (tmp_path / "kernels-2" / "complete").touch()
    assert f"what lies in {tmp_path} is for others" in check_kernels(False, folder, name, [tmp_path]).found
    (tmp_path / "file").touch()
    nowhere = check_kernels(False, tmp_path / "file" / "kernels-1", name, [])
    assert "NUMBA_CACHE_DIR" in nowhere.remedy


def taken(*durations_ms, computed=1.0):
    durations_s = [each / 1000.0 for each in durations_ms]
    return Taken(durations_s, computed * sum(durations_s))


@pytest.mark.parametrize(
    ("measured", "state"),
    [
        (taken(*[20.0] * 60), "ok"),
        (taken(*[20.0] * 59, 90.0), "ok"),
        (taken(*[20.0] * 59, 130.0), "warning"),
        (taken(*[70.0] * 60), "warning"),
        (taken(*[20.0] * 50, *[120.0] * 10), "failed"),
        (taken(*[150.0] * 10), "failed"),
    ],
)
def test_decisions_are_held_against_the_deadline(measured, state):
    told = judged(measured, 0.1, "8 robots expected", None)
    assert told.state == state
    assert ("--budget-ms" in told.remedy) == (state != "ok")
    assert "8 robots expected, no budget: median" in told.found


def test_whoever_has_a_budget_is_not_told_to_set_one_and_a_busy_device_is_named():
    told = judged(taken(*[150.0] * 10, computed=0.5), 0.1, "8 robots", 0.05)
    assert "a budget of 50 ms" in told.found
    assert "others that run here took 50 % of the time" in told.found
    assert "--budget-ms" not in told.remedy


def test_everybody_crosses_within_limits_and_keeps_apart_from_whom_it_does_not_see():
    scene = scene_of("a", 8)
    assert list(scene.robots) == ["a", "1", "2", "3", "4", "5", "6", "7"]
    crossing = Crossing(scene, "a", 60)
    first = crossing.observation(0).robots
    for _ in range(60):
        crossing.drive(STANDSTILL)
    last = crossing.observation(60).robots
    assert last["a"] == first["a"], "it decides for itself"
    for name in set(last) - {"a"}:
        driven_m = np.hypot(last[name].x_m - first[name].x_m, last[name].y_m - first[name].y_m)
        assert 3.0 < driven_m < 9.0
        assert 0.0 < last[name].speed_mps <= 1.5
    spots = np.array([(each.x_m, each.y_m) for each in first.values()])
    apart_m = np.hypot(*(spots[:, None] - spots[None]).T)[~np.eye(8, dtype=bool)]
    assert apart_m.min() > scene.safety_distance_m("a", "1")


@pytest.mark.parametrize("goals", ["ioc", "exchanged", "constant-velocity"])
def test_decisions_are_really_made(goals, monkeypatch):
    monkeypatch.setattr("agent.check.speed.DECISIONS", FEWEST)
    scene = scene_of("1", 3).model_copy(update={"horizons": Horizons(prediction_steps=6, estimation_steps=3)})
    measured = measure(device("tcp/127.0.0.1:7447", goals=goals), scene)
    assert len(measured.durations_s) == FEWEST
    assert min(measured.durations_s) > 0.0
    assert measured.computed_s > 0.0


def test_a_slow_device_is_not_measured_for_ever(monkeypatch):
    monkeypatch.setattr("agent.check.speed.LONGEST_S", 0.0)
    measured = measure(device("tcp/127.0.0.1:7447"), scene_of("1", 1))
    assert len(measured.durations_s) == FEWEST


@pytest.fixture
def check(monkeypatch):
    """The command line with these findings instead of a check."""

    def run(states, *arguments):
        items = [Finding(f"item {number}", state, "found", "help") for number, state in enumerate(states)]
        monkeypatch.setattr(agent.check.device, "findings", lambda *_: iter(items))
        return CliRunner().invoke(app, ["agent", "--robot", "1", "--goal", "4,0,0", "--check", *arguments])

    return run


def test_a_line_an_item_and_the_verdict(check):
    told = check(["ok", "warning", "ok"])
    assert (told.exit_code, told.output.splitlines()[1]) == (0, "warning  item 1         found; help")
    assert told.output.splitlines()[-1] == "ready, 1 warning"
    told = check(["ok", "failed", "warning", "failed"])
    assert (told.exit_code, told.output.splitlines()[-1]) == (1, "not ready: 2 failed, 1 warning")


def test_on_a_terminal_an_item_is_wrapped_under_itself():
    finding = Finding("clock", "warning", "it says 2026-11-30 14:50 UTC", "let a time service keep it right")
    lines = finding.line(60).splitlines()
    assert len(lines) == 2
    assert max(map(len, lines)) <= 60
    assert lines[1].startswith(24 * " ")
    assert " ".join(each.strip() for each in lines) == finding.line()


def test_the_same_as_json(check):
    told = check(["ok", "failed"], "--json")
    assert told.exit_code == 1
    content = json.loads(told.output)
    assert content["ready"] is False
    assert content["items"][1] == {"item": "item 1", "state": "failed", "found": "found", "remedy": "help"}
