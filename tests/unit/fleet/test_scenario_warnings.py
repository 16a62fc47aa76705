"""Scenarios in which robots cannot be safe: which they are, and what is said of them."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from evaluation_helpers import evaluation_of, write_suite
from typer.testing import CliRunner

from fleet.cli import app
from fleet.inject.scenario import Scenario, warnings_of

ROBOTS = [
    {"id": "1", "start": {"x_m": -4.0, "y_m": 0.0}, "goal": {"x_m": 4.0, "y_m": 0.0}},
    {"id": "2", "start": {"x_m": 0.0, "y_m": -4.0}, "goal": {"x_m": 0.0, "y_m": 4.0}},
]
"""From 4.5 m/s, with 3 m/s² and 7 m/s³, each brakes for 1.5 + 3/7 = 1.93 s and 4.34 m."""


def warned(robots: list[dict[str, Any]] = ROBOTS, **rules: Any) -> list[str]:
    return warnings_of(Scenario.model_validate({"name": "test", "robots": robots, **rules}))


@pytest.mark.parametrize(
    ("step_s", "steps", "told"),
    [
        (0.1, 30, None),
        (0.1, 20, None),
        (0.1, 19, "19 × 0.1 s = 1.9 s is shorter than the 1.93 s that robot '1' takes to brake"),
        (0.02, 30, "30 × 0.02 s = 0.6 s is shorter than the 1.93 s that robot '1' takes to brake"),
    ],
)
def test_a_horizon_has_to_cover_braking(step_s: float, steps: int, told: str | None) -> None:
    horizons = {"prediction_steps": steps, "estimation_steps": 3}
    found = warned(step_s=step_s, horizons=horizons)
    assert len(found) == (told is not None)
    if found:
        [needed] = [
            int(word) for word in found[0].split("prediction_steps to ")[1].split() if word.isdecimal()
        ]
        assert warned(step_s=step_s, horizons=horizons | {"prediction_steps": needed}) == []
        assert warned(step_s=step_s, horizons=horizons | {"prediction_steps": needed - 1}) != []
        assert told is not None
        assert told in found[0]


def test_a_range_has_to_cover_the_braking_of_both_and_their_safety_distance() -> None:
    """2 × 4.34 m + 1.39 m = 10.07 m; a crawler beside them needs 4.34 m less, and nothing alone."""
    assert warned(sensing={"range_m": 10.1}) == []
    [told] = warned(sensing={"range_m": 10.0})
    assert told.startswith("robot '1' sees others within 10 m, ")
    assert "10.1 m" in told
    slow = ROBOTS[1] | {"limits": {"speed_mps": 0.1, "jerk_mps3": 100.0}}
    assert warned([ROBOTS[0], slow], sensing={"range_m": 5.8}) == []
    assert len(warned([ROBOTS[0], slow], sensing={"range_m": 5.7})) == 1
    assert warned(ROBOTS[:1], sensing={"range_m": 1.0}) == []
    assert "robot '2'" in warned([ROBOTS[0], ROBOTS[1] | {"sensing": {"range_m": 3.0}}])[0]


def test_runs_say_so_once_and_keep_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    horizons = {"prediction_steps": 5, "estimation_steps": 3}
    Path("short.yaml").write_text(
        yaml.safe_dump({"name": "short", "time_limit_s": 0.2, "robots": ROBOTS, "horizons": horizons})
    )
    result = CliRunner().invoke(app, ["simulate", "short.yaml", "--out", "out"])
    assert result.stderr.count("Warning: the prediction horizon of 5 × 0.1 s") == 1
    assert result.stderr.endswith("to a larger value.\n")
    assert "the prediction horizon of 5 × 0.1 s" in Path("out/summary.json").read_text()


def test_an_evaluation_says_so_once_a_scenario_and_reason(tmp_path: Path) -> None:
    suite = write_suite(tmp_path / "suite", "a", "b")
    told = list(evaluation_of(suite, noise=("none", "low", "range_m=1"), seeds=3).warnings())
    assert [line.split(" ")[0] for line in told] == ["a:", "a:", "b:", "b:"]
    assert ["range" in line for line in told] == [False, True, False, True]
