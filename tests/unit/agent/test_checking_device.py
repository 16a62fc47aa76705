"""What the check of a device says of its clocks, its kernels and its speed, and how it says it."""

import json
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from agent_helpers import device
from typer.testing import CliRunner

import agent.check.device
from agent.check import Finding
from agent.check.device import check_kernels, check_steady_clock, check_wall_clock, is_synchronised
from agent.check.speed import FEWEST, crossing, default_scene, judged, measure
from agent.cli import app
from agent.solve.compiled import processor
from protocol.scene import Horizons

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
    assert check_wall_clock(now, NOW - timedelta(days=1), synchronised).state == state


@pytest.mark.parametrize(
    ("passes_s", "state"), [(0.05, "ok"), (0.0, "failed"), (-1.0, "failed"), (60.0, "failed")]
)
def test_the_steady_clock_advances(passes_s, state):
    times = iter([100.0, 100.0 + passes_s])
    assert check_steady_clock(lambda: next(times), lambda _: None).state == state


def test_the_real_clocks_can_be_asked():
    assert check_steady_clock().state == "ok"
    assert is_synchronised() in (True, False, None)


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


@pytest.mark.parametrize(
    ("durations_ms", "state"),
    [
        ([20.0] * 60, "ok"),
        ([*[20.0] * 59, 90.0], "ok"),
        ([*[20.0] * 59, 130.0], "warning"),
        ([70.0] * 60, "warning"),
        ([*[20.0] * 50, *[120.0] * 10], "failed"),
        ([150.0] * 10, "failed"),
    ],
)
@pytest.mark.parametrize("budget_s", [None, 0.05])
@pytest.mark.parametrize("held_up", [0.0, 0.5])
def test_decisions_are_held_against_the_deadline(durations_ms, state, budget_s, held_up):
    """Whoever has a budget is not told to set one; and a busy device is named."""
    durations_s = [each / 1000.0 for each in durations_ms]
    told = judged(durations_s, held_up, 0.1, "8 robots expected", budget_s)
    assert told.state == state
    assert ("--budget-ms" in told.remedy) == (state != "ok" and budget_s is None)
    assert f"8 robots expected, {'a budget of 50 ms' if budget_s else 'no budget'}: median" in told.found
    assert ("others that run here took 50 % of the time" in told.found) == bool(held_up)


def test_everybody_crosses_within_limits_and_keeps_apart_at_first():
    scene = default_scene("a", 8)
    assert list(scene.robots) == ["a", "1", "2", "3", "4", "5", "6", "7"]
    goals, ways = crossing(scene, 60)
    assert set(goals) == set(ways) == set(scene.robots)
    states = np.array(list(ways.values()))
    assert states.shape == (8, 61, 4)
    assert np.all(states[..., 3] == 1.5)
    apart_m = np.hypot(*(states[:, None, 0, :2] - states[None, :, 0, :2]).T)[~np.eye(8, dtype=bool)]
    assert apart_m.min() > scene.safety_distance_m("a", "1")


@pytest.mark.parametrize("goals", ["ioc", "exchanged", "constant-velocity"])
def test_decisions_are_really_made(goals, monkeypatch):
    monkeypatch.setattr("agent.check.speed.DECISIONS", FEWEST)
    horizons = Horizons(prediction_steps=6, estimation_steps=3)
    scene = default_scene("1", 3).model_copy(update={"horizons": horizons})
    durations_s, held_up = measure(device(goals=goals), scene)
    assert len(durations_s) == FEWEST
    assert min(durations_s) > 0.0
    assert 0.0 <= held_up < 1.0


def test_a_slow_device_is_not_measured_for_ever(monkeypatch):
    monkeypatch.setattr("agent.check.speed.LONGEST_S", 0.0)
    durations_s, _ = measure(device(), default_scene("1", 1))
    assert len(durations_s) == FEWEST


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


def test_the_same_as_json(check):
    told = check(["ok", "failed"], "--json")
    assert told.exit_code == 1
    content = json.loads(told.output)
    assert content["ready"] is False
    assert content["items"][1] == {"item": "item 1", "state": "failed", "found": "found", "remedy": "help"}
