"""The levels of noise and the runs that an evaluation asks for, and the row that comes of one."""

import json
import math
import re
import statistics
import threading
from pathlib import Path

import pytest
from evaluation_helpers import evaluation_of, write_suite
from typer.testing import CliRunner

from agent.agent import Agent
from agent.estimate.goals import Exchanged
from agent.remember.memory import Memory
from fleet.cli import app
from fleet.evaluate.evaluation import levels_in, sensing_of, with_noise
from fleet.evaluate.running import execute
from protocol.messages import Mind
from protocol.scenario import Sensing
from scenarios import find

PHASES = ("estimate", "predict", "plan", "decide")


@pytest.mark.parametrize(
    ("sensing", "levels", "seeds", "spared"),
    [
        ({}, ("low", "high"), {"low": 3, "high": 3}, 0),
        ({}, ("none", "low"), {"none": 1, "low": 3}, 2),
        ({"speed_noise_mps": 0.1}, ("none",), {"none": 3}, 0),
        ({"dropout": 0.5}, ("none",), {"none": 3}, 0),
        ({"delay_steps": 1}, ("none",), {"none": 1}, 2),
    ],
)
def test_there_is_a_run_for_every_scenario_method_level_and_seed_but_one_seed_where_nothing_is_random(
    tmp_path: Path, sensing, levels, seeds, spared
):
    suite = write_suite(tmp_path / "suite", "one", "two", sensing=sensing)
    evaluation = evaluation_of(suite, seeds=3, noise=levels)
    assert [run.key for run in evaluation.runs()] == [
        (scenario, method, "realtime", level, seed)
        for scenario in ("one", "two")
        for level in levels
        for seed in range(seeds[level])
        for method in ("exchanged", "ioc")
    ]
    assert evaluation.spared_seeds == spared


def test_a_level_of_noise_holds_for_every_robot_and_replaces_all_that_the_file_says(tmp_path: Path):
    suite = write_suite(tmp_path / "suite", "one", sensing={"range_m": 3.0, "dropout": 0.1})
    (scenario,) = evaluation_of(suite).scenarios.values()
    first, second = scenario.robots
    with_own = first.model_copy(update={"sensing": scenario.sensing})
    own = scenario.model_copy(update={"robots": [with_own, second]})
    noisy = with_noise(own, "medium+delay_steps=2")
    for robot in noisy.robots:
        assert noisy.sensing_of(robot) == sensing_of("medium+delay_steps=2")
    assert with_noise(own, "none") == own


LOW = {"position_noise_m": 0.02, "heading_noise_rad": math.radians(2.0), "speed_noise_mps": 0.05}


@pytest.mark.parametrize(
    ("level", "sensing"),
    [
        ("low", LOW),
        ("medium", {name: 2.0 * value for name, value in LOW.items()}),
        ("high", {name: 4.0 * value for name, value in LOW.items()}),
        ("range_m=5", {"range_m": 5}),
        ("low+dropout=0.3+delay_steps=2", {**LOW, "dropout": 0.3, "delay_steps": 2}),
        ("position_noise_m=1e-2+speed_noise_mps=0", {"position_noise_m": 0.01}),
    ],
)
def test_a_level_is_made_of_names_and_fields(level, sensing):
    assert sensing_of(level) == Sensing(**sensing)


def test_a_list_of_levels_names_each_once():
    assert levels_in("none, low,low+delay_steps=2,none") == ("none", "low", "low+delay_steps=2")


@pytest.mark.parametrize(
    ("level", "told"),
    [
        ("deafening", "'deafening' found, one of low, medium, high or FIELD=VALUE is expected"),
        ("low+", "'' found"),
        ("none+low", "'none' found"),
        ("loudness=3", "'loudness' found, one of range_m, position_noise_m, "),
        ("dropout=often", "'dropout=often': dropout: Input should be a valid number"),
        ("dropout=2", "'dropout=2': dropout: Input should be less than or equal to 1, found 2"),
        ("delay_steps=1.5", "delay_steps: Input should be a valid integer"),
        ("dropout=nan", "dropout: Input should be a finite number"),
        ("low+position_noise_m=0.1", "'low+position_noise_m=0.1' says position_noise_m twice"),
    ],
)
def test_a_level_that_cannot_be_understood_is_refused_with_what_is_expected(level, told):
    with pytest.raises(ValueError, match=re.escape(told)):
        levels_in(f"none,{level}")


def test_a_row_says_what_a_simulation_of_the_same_run_says(tmp_path: Path):
    arguments = ["simulate", "2-crossing", "--goals", "exchanged", "--out", str(tmp_path / "out")]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    (run,) = evaluation_of(find("2-crossing"), goals=("exchanged",)).runs()
    row = execute(run)
    same = ("verdict", "seed", "solver", "duration_s", "minimum_distance_m", "collisions", "steps")
    same += ("solver_failures", "clipped_commands")
    assert {name: getattr(row, name) for name in same} == {name: summary[name] for name in same}
    assert (row.scenario, row.method, row.verdict) == ("2-crossing", "exchanged", "arrived")
    assert row.robots == row.arrived == len(summary["robots"])
    arrivals_s, driven_m = (
        [robot[name] for robot in summary["robots"]] for name in ("arrived_s", "driven_m")
    )
    assert row.robot_duration_mean_s == pytest.approx(statistics.mean(arrivals_s))
    assert row.robot_driven_mean_m == pytest.approx(statistics.mean(driven_m))
    assert row.driven_m == pytest.approx(sum(driven_m))


def test_what_others_do_meanwhile_counts_as_wall_clock_time_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (run,) = evaluation_of(write_suite(tmp_path / "suite", "one"), goals=("exchanged",)).runs()
    execute(run)
    estimate = Exchanged.estimate

    def be_held_up(estimator: Exchanged, memory: Memory):
        threading.Event().wait(0.1)
        return estimate(estimator, memory)

    monkeypatch.setattr(Exchanged, "estimate", be_held_up)
    row = execute(run)
    assert row.decide_cpu_p50_ms < 50.0
    assert row.cpu_s < 0.5 * row.wall_s
    assert row.wall_s >= 0.1 * 2 * row.steps


def test_a_run_out_of_time_has_no_durations_and_no_phase_takes_longer_than_the_whole(tmp_path: Path):
    (run,) = evaluation_of(write_suite(tmp_path / "suite", "one"), goals=("ioc",)).runs()
    row = execute(run)
    assert (row.verdict, row.arrived, row.steps, row.reason) == ("timeout", 0, 5, None)
    assert row.duration_s is row.robot_duration_mean_s is None
    assert row.driven_m > 0.0
    for phase in PHASES:
        p50, p99, most = (getattr(row, f"{phase}_cpu_{name}_ms") for name in ("p50", "p99", "max"))
        assert 0.0 < p50 <= p99 <= most <= 1e3 * row.cpu_s
    assert row.cpu_s <= row.wall_s + 0.01


def test_a_run_that_raises_is_a_failed_row_with_the_reason_and_the_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (run,) = evaluation_of(write_suite(tmp_path / "suite", "one"), goals=("exchanged",)).runs()

    def stumble(_agent: Agent, _observation: object) -> Mind:
        raise ArithmeticError("no way\nout")

    monkeypatch.setattr(Agent, "decide", stumble)
    row = execute(run)
    assert (row.key, row.robots, row.verdict) == (run.key, 2, "failed")
    assert row.reason.startswith("ArithmeticError: no way out (test_evaluation_runs.py:")
    filled = {name for name, value in row if value is not None}
    assert filled == {*row.key._fields, "robots", "verdict", "reason"}
