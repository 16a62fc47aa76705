"""Evaluations: their runs and rows, the command, and what it leaves, which survives interruptions."""

import json
import math
import re
import statistics
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import nullcontext
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import Result
from distributed import KilledWorker
from evaluation_helpers import SHORT, evaluation_of, write_suite
from typer.testing import CliRunner

from agent.agent import Agent
from agent.process import options
from chassis.refusal import Refusal
from fleet.cli import app
from fleet.evaluate import running
from fleet.evaluate.evaluation import Evaluation, Run, levels_in, sensing_of, with_noise
from fleet.evaluate.results import COLUMNS, RUNS, Row, open_results, read_evaluation, read_rows
from fleet.evaluate.running import execute
from protocol.messages import Mind
from protocol.scenario import Sensing


@pytest.fixture
def evaluation(tmp_path: Path) -> Evaluation:
    return evaluation_of(write_suite(tmp_path / "suite", "one", "two"))


@pytest.fixture
def evaluate(tmp_path: Path, evaluation: Evaluation) -> Callable[..., Result]:
    """The same as a command, in ``out``."""
    suite, out = str(tmp_path / "suite"), str(tmp_path / "out")
    return lambda *given: CliRunner().invoke(app, ["evaluate", suite, *map(str, given), "--out", out])


class InThisProcess:
    """What an evaluation needs of a Dask client; each run is made when it is submitted, by ``make``."""

    status = "running"

    def __init__(self, make: Any) -> None:
        self.make = make

    def submit(self, _function: Any, run: Any, **_options: object) -> "Future[Any]":
        future: Future[Any] = Future()
        try:
            future.set_result(self.make(run))
        except Exception as error:
            future.set_exception(error)
        return future

    def cancel(self, _futures: object) -> None:
        pass


def use(monkeypatch: pytest.MonkeyPatch, client: InThisProcess) -> None:
    """Let evaluations use this client instead of a cluster."""
    monkeypatch.setattr(running, "local_cluster", lambda _workers: nullcontext(client))


def arrived(run: Run) -> Row:
    duration_s = 8.0 if run.key.method == "ioc" else 6.0
    return Row(**run.key._asdict(), robots=2, verdict="arrived", duration_s=duration_s, collisions=0)


def line_of(output: str, method: str) -> list[str]:
    line, _encounters = [line for line in output.splitlines() if line.split()[:1] == [method]]
    return line.split()


def test_a_failed_run_is_a_row_and_the_others_are_made(
    evaluate: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def drive(run: Run) -> Row:
        if run.key[:2] == ("one", "ioc"):
            return Row.without_result(run, "ArithmeticError: no way")
        if run.key[:2] == ("two", "ioc"):
            raise KilledWorker("execute", None, 3)
        return arrived(run)

    use(monkeypatch, InThisProcess(drive))
    result = evaluate("--goals", "exchanged,ioc")
    assert result.exit_code == 3
    told = {(row.scenario, row.method): row.reason for row in read_rows(tmp_path / "out")}
    assert told == {
        ("one", "exchanged"): None,
        ("one", "ioc"): "ArithmeticError: no way",
        ("two", "exchanged"): None,
        ("two", "ioc"): "the worker process died each time that this was tried",
    }
    assert line_of(result.stdout, "exchanged") == ["exchanged", "none", "2", "2", "0", "0", "6", "–", "–"]
    assert line_of(result.stdout, "ioc") == ["ioc", "none", "2", "0", "0", "2", "–", "–", "–"]


def test_the_same_command_repeats_no_run(evaluate: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    driven = []
    use(monkeypatch, InThisProcess(lambda run: driven.append(run) or arrived(run)))
    assert evaluate("--goals", "exchanged").exit_code == 0
    kept = (tmp_path / "out" / "runs.csv").read_bytes()
    again = evaluate("--goals", "exchanged")
    assert again.exit_code == 0
    assert "2 of 2 runs are there already" in again.stderr
    assert line_of(again.stdout, "exchanged")[2] == "2"
    assert len(driven) == 2
    assert (tmp_path / "out" / "runs.csv").read_bytes() == kept


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--goals", "exchanged,psychic"), "'psychic' found, one or more of exchanged, ioc"),
        (("--goals", "exchanged,orca"), "orca needs the library pyrvo"),
        (("--noise", "deafening"), "'deafening' found, one of low, medium, high or FIELD=VALUE"),
        (("--workers", 2, "--dask", "tcp://127.0.0.1:1"), "leave out one of"),
    ],
)
def test_wrong_usage_is_refused_before_anything_is_run(
    evaluate: Any, tmp_path: Path, arguments: tuple[object, ...], told: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(options, "is_available", lambda: False)
    result = evaluate(*arguments)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.replace("│", " ").split())
    assert not (tmp_path / "out").exists()


@pytest.fixture
def failed(evaluation: Evaluation) -> Row:
    run, *_ = evaluation.runs()
    return Row.without_result(run, 'ValueError: a comma, a "quote"\nand a line break')


@pytest.fixture
def finished(evaluation: Evaluation) -> Row:
    *_, run = evaluation.runs()
    figures = {"duration_s": 0.1 + 0.2, "minimum_distance_m": 1.0 / 3.0, "collisions": 0}
    return Row(**run.key._asdict(), robots=2, verdict="arrived", **figures)


def test_all_is_kept_at_once_and_read_as_it_was_written_bit_for_bit(
    tmp_path: Path, evaluation: Evaluation, failed: Row, finished: Row
):
    with open_results(tmp_path / "out", evaluation) as results:
        results.add(failed)
        results.add(finished)
        assert read_rows(tmp_path / "out") == [failed, finished]
    assert failed.reason == 'ValueError: a comma, a "quote" and a line break'
    with open_results(tmp_path / "out", evaluation) as resumed:
        assert resumed.rows == {failed.key: failed, finished.key: finished}
    assert read_evaluation(tmp_path / "out") == evaluation


def test_whatever_was_written_of_a_header_or_of_the_last_row_is_dropped(
    tmp_path: Path, evaluation: Evaluation, failed: Row
):
    out = tmp_path / "out"
    with open_results(out, evaluation) as results:
        results.add(failed)
    whole = (out / RUNS).read_bytes()
    header = len(",".join(COLUMNS)) + 1
    for length in range(0, len(whole), 23):
        (out / RUNS).write_bytes(whole[:length])
        assert read_rows(out) == []
        with open_results(out, evaluation) as resumed:
            assert (out / RUNS).read_bytes() == whole[:header]
            resumed.add(failed)
        assert (out / RUNS).read_bytes() == whole


def test_what_differs_from_the_evaluation_of_a_directory_is_told_but_the_machine_may_be_another(
    evaluation: Evaluation,
):
    machine, one = evaluation.machine, evaluation.scenarios["one"]
    scenarios = {"one": one.model_copy(update={"time_limit_s": 0.7}), "three": one}
    for choices, told in (
        ({"seeds": 2}, ["seeds: 1 there, 2 here"]),
        ({"goals": ("ioc",)}, ["goals: exchanged,ioc there, ioc here"]),
        (
            {"machine": machine.model_copy(update={"commit": "1"})},
            [f"commit: {machine.commit} there, 1 here"],
        ),
        (
            {"scenarios": scenarios},
            ["scenario one: changed", "scenario two: there only", "scenario three: here only"],
        ),
        ({"machine": machine.model_copy(update={"cpu": "another one", "cores": 64})}, []),
    ):
        assert evaluation.differences(evaluation.model_copy(update=choices)) == told


def test_two_evaluations_cannot_write_to_one_directory_at_a_time(tmp_path: Path, evaluation: Evaluation):
    with (
        open_results(tmp_path / "out", evaluation),
        pytest.raises(Refusal, match="another evaluation is writing there"),
        open_results(tmp_path / "out", evaluation),
    ):
        pass


def test_a_directory_of_something_else_or_of_a_different_evaluation_is_left_alone(
    tmp_path: Path, evaluation: Evaluation
):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(Refusal, match="holds no evaluation"), open_results(tmp_path, evaluation):
        pass
    assert not (tmp_path / RUNS).exists()
    with open_results(tmp_path / "out", evaluation):
        pass
    other = evaluation.model_copy(update={"seeds": 2})
    with pytest.raises(Refusal, match="  seeds: 1 there, 2 here\n"), open_results(tmp_path / "out", other):
        pass
    assert read_evaluation(tmp_path / "out") == evaluation


def test_a_damaged_row_is_told_with_its_line(tmp_path: Path, evaluation: Evaluation, failed: Row):
    with open_results(tmp_path / "out", evaluation) as results:
        results.add(failed)
    with (tmp_path / "out" / RUNS).open("a") as file:
        file.write("one,2\n")
    with pytest.raises(Refusal, match=r"runs\.csv:3: not a row"), open_results(tmp_path / "out", evaluation):
        pass


@pytest.mark.parametrize(
    ("sensing", "seeds", "spared"),
    [
        ({}, {"low": 3, "high": 3}, 0),
        ({}, {"none": 1, "low": 3}, 2),
        ({"dropout": 0.5}, {"none": 3}, 0),
        ({"delay_steps": 1}, {"none": 1}, 2),
    ],
)
def test_there_is_a_run_for_every_scenario_method_level_and_seed_but_one_seed_where_nothing_is_random(
    tmp_path: Path, sensing, seeds, spared
):
    suite = write_suite(tmp_path / "suite", "one", "two", sensing=sensing)
    evaluation = evaluation_of(suite, seeds=3, noise=tuple(seeds))
    assert [run.key for run in evaluation.runs()] == [
        (scenario, method, "realtime", level, seed)
        for scenario in ("one", "two")
        for level in seeds
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
        ("high", {name: 4.0 * value for name, value in LOW.items()}),
        ("low+dropout=0.3+delay_steps=2", {**LOW, "dropout": 0.3, "delay_steps": 2}),
        ("position_noise_m=1e-2+speed_noise_mps=0", {"position_noise_m": 0.01}),
    ],
)
def test_a_level_is_made_of_names_and_fields(level, sensing):
    assert sensing_of(level) == Sensing(**sensing)
    assert levels_in(f"none, {level},none") == ("none", level), "each once"


@pytest.mark.parametrize(
    ("level", "told"),
    [
        ("none+low", "'none' found, one of low, medium, high or FIELD=VALUE is expected"),
        ("loudness=3", "'loudness' found, one of range_m, position_noise_m, "),
        ("dropout=2", "'dropout=2': dropout: Input should be less than or equal to 1, found 2"),
        ("low+position_noise_m=0.1", "'low+position_noise_m=0.1' says position_noise_m twice"),
    ],
)
def test_a_level_that_cannot_be_understood_is_refused_with_what_is_expected(level, told):
    with pytest.raises(ValueError, match=re.escape(told)):
        levels_in(f"none,{level}")


def test_a_row_says_what_a_simulation_of_the_same_run_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("fleet.record.picture.DOTS_PER_INCH", 20)
    robots = [{**robot, "goal": {**robot["goal"], "x_m": 0.5}} for robot in SHORT["robots"]]
    suite = write_suite(tmp_path / "suite", "near", robots=robots, time_limit_s=5.0)
    arguments = ["simulate", suite / "near.yaml", "--goals", "exchanged", "--out", tmp_path / "out"]
    assert CliRunner().invoke(app, [*map(str, arguments)]).exit_code == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    (run,) = evaluation_of(suite, goals=("exchanged",)).runs()
    row = execute(run)
    same = ("verdict", "seed", "solver", "duration_s", "minimum_distance_m", "collisions", "steps")
    same += ("solver_failures", "clipped_commands", "interventions", "side_disagreement", "side_pair_steps")
    assert {name: getattr(row, name) for name in same} == {name: summary[name] for name in same}
    for of in ("collision", "safety"):
        assert getattr(row, f"closest_to_{of}") == summary["relative_distances"][f"to_{of}"]["min"]
    assert row.closest_to_collision == pytest.approx(row.minimum_distance_m / 0.99)
    assert (row.scenario, row.method, row.verdict) == ("near", "exchanged", "arrived")
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
    ticks = count()
    clocks = {"thread_time": lambda: 1e-6 * next(ticks), "perf_counter": count(0.0, 100.0).__next__}
    monkeypatch.setattr(running, "time", SimpleNamespace(**clocks))
    row = execute(run)
    assert row.wall_s == 100.0
    assert 0.0 < row.decide_cpu_max_ms < 1e3 * row.cpu_s < 1.0


def test_a_run_out_of_time_has_no_durations_and_no_phase_takes_longer_than_the_whole(tmp_path: Path):
    (run,) = evaluation_of(write_suite(tmp_path / "suite", "one"), goals=("ioc",)).runs()
    row = execute(run)
    assert (row.verdict, row.arrived, row.steps, row.reason) == ("timeout", 0, 5, None)
    assert row.duration_s is row.robot_duration_mean_s is None
    assert row.driven_m > 0.0
    for phase in ("estimate", "predict", "plan", "decide"):
        p50, p99, most = (getattr(row, f"{phase}_cpu_{name}_ms") for name in ("p50", "p99", "max"))
        assert 0.0 < p50 <= p99 <= most <= 1e3 * row.cpu_s


def test_a_run_that_raises_is_a_failed_row_with_the_reason_and_the_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (run,) = evaluation_of(write_suite(tmp_path / "suite", "one"), goals=("exchanged",)).runs()

    def stumble(_agent: Agent, _observation: object) -> Mind:
        raise ArithmeticError("no way\nout")

    monkeypatch.setattr(Agent, "decide", stumble)
    row = execute(run)
    assert (row.key, row.robots, row.verdict) == (run.key, 2, "failed")
    assert row.reason.startswith("ArithmeticError: no way out (test_evaluation.py:")
    filled = {name for name, value in row if value is not None}
    assert filled == {*row.key._fields, "robots", "verdict", "reason"}
