"""What the check of a device says of its clocks, its kernels and its speed, and how it says it."""

import json
from datetime import UTC, datetime, timedelta

import pytest
from agent_helpers import device
from typer.testing import CliRunner

import agent.check.device
from agent.check import Finding
from agent.check.device import check_kernels, check_steady_clock, check_wall_clock
from agent.check.speed import FEWEST, default_scene, judged, measure
from agent.cli import app
from agent.solve.compiled import processor
from protocol.scene import Horizons

NOW = datetime(2026, 6, 1, 12, 0, tzinfo=UTC)


@pytest.mark.parametrize(
    ("days", "synchronised", "state"),
    [(1, True, "ok"), (1, None, "ok"), (1, False, "warning"), (-400, True, "failed")],
)
def test_the_time_of_day_is_kept_right_and_not_before_the_installation(days, synchronised, state):
    assert check_wall_clock(NOW + timedelta(days=days), NOW, synchronised).state == state


@pytest.mark.parametrize(
    ("passes_s", "state"), [(0.05, "ok"), (0.0, "failed"), (-1.0, "failed"), (60.0, "failed")]
)
def test_the_steady_clock_advances(passes_s, state):
    times = iter([100.0, 100.0 + passes_s])
    assert check_steady_clock(lambda: next(times), lambda _: None).state == state


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


@pytest.mark.parametrize(
    ("goals", "limit", "value"), [("ioc", "DECISIONS", FEWEST), ("exchanged", "LONGEST_S", 0.0)]
)
def test_decisions_are_really_made_and_not_for_ever(goals, limit, value, monkeypatch):
    monkeypatch.setattr(f"agent.check.speed.{limit}", value)
    horizons = Horizons(prediction_steps=6, estimation_steps=3)
    scene = default_scene("1", 3).model_copy(update={"horizons": horizons})
    durations_s, held_up = measure(device(goals=goals), scene)
    assert len(durations_s) == FEWEST
    assert min(durations_s) > 0.0
    assert 0.0 <= held_up < 1.0


@pytest.mark.parametrize(
    ("states", "status", "verdict"),
    [
        (["ok", "warning", "ok"], 0, "ready, 1 warning"),
        (["ok", "failed", "warning", "failed"], 1, "not ready: 2 failed, 1 warning"),
    ],
)
def test_a_line_an_item_and_the_verdict_or_the_same_as_json(states, status, verdict, monkeypatch):
    items = [Finding(f"item {number}", state, "found", "help") for number, state in enumerate(states)]
    monkeypatch.setattr(agent.check.device, "findings", lambda *_: iter(items))
    command = ["agent", "--robot", "1", "--goal", "4,0,0", "--check"]
    told, content = (CliRunner().invoke(app, [*command, *more]) for more in ([], ["--json"]))
    assert told.exit_code == content.exit_code == status
    assert [line.split()[0] for line in told.output.splitlines()[:-1]] == states
    assert told.output.splitlines()[-1] == verdict
    found = json.loads(content.output)
    assert (found["ready"], found["items"]) == (status == 0, [each._asdict() for each in items])
