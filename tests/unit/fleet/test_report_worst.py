"""The worst runs: which are chosen, and how they are shown."""

import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from evaluation_helpers import evaluation_of, write_suite
from reporting_helpers import never, page_of, row, unspoken_report, write_evaluation

from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import DIED, EXPERIMENT, RUNS, Row
from fleet.evaluate.running import execute
from fleet.inject.scenario import load_scenario
from fleet.report import command
from fleet.report.command import worst_runs
from fleet.report.figures import Chart


@pytest.fixture(autouse=True)
def _undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Charts are empty and intervals coarse, which otherwise take the most time."""
    monkeypatch.setattr(Chart, "png", lambda _self: b"no picture")
    monkeypatch.setattr("fleet.report.data.RESAMPLES", 200)


def test_failed_runs_come_first_then_collisions_then_robots_that_never_arrive_then_slow_ones(tmp_path: Path):
    evaluation = evaluation_of(write_suite(tmp_path / "suite", *"abcdefghij"))
    runs = {run.key[:2]: run for run in evaluation.runs()}

    def ioc(stem: str) -> Run:
        return runs[stem, "ioc"]

    rows = [
        row(runs["a", "exchanged"], duration_s=6.0),
        row(ioc("a"), duration_s=9.0),
        row(runs["b", "exchanged"], duration_s=10.0),
        row(ioc("b"), duration_s=12.0),
        never(ioc("c"), "timeout", arrived=1),
        never(ioc("d"), "deadlock", arrived=0),
        row(ioc("e"), collisions=1, minimum_distance_m=0.9),
        row(ioc("f"), collisions=1, minimum_distance_m=0.8),
        row(ioc("g"), collisions=2, minimum_distance_m=0.95),
        Row.without_result(ioc("h"), "ArithmeticError: no way"),
        row(ioc("i"), duration_s=8.0),
        row(ioc("j"), duration_s=9.0),
    ]
    told = worst_runs(rows, "exchanged", 20)
    assert [(each.row.scenario, each.why) for each in told if each.row.method == "ioc"] == [
        ("h", "failed: ArithmeticError: no way"),
        ("g", "collision of 2 pairs of robots"),
        ("f", "collision of 1 pair of robots"),
        ("e", "collision of 1 pair of robots"),
        ("d", "deadlock: 0 of 2 robots arrived"),
        ("c", "timeout: 1 of 2 robots arrived"),
        ("a", "took 9.0 s, 1.50 times as long as with exchanged"),
        ("b", "took 12.0 s, 1.20 times as long as with exchanged"),
        ("j", "took 9.0 s"),
        ("i", "took 8.0 s"),
    ]
    assert worst_runs(rows, "exchanged", 2) == told[:2]


def test_the_worst_run_is_driven_again_as_it_was_and_the_told_command_repeats_it(tmp_path: Path):
    out = tmp_path / "out"
    data = write_evaluation(out, ("short",), execute, goals=("joint-fit",), noise=("low",))
    result = unspoken_report(out, "--worst", 1)
    assert result.exit_code == 0, result.stderr
    page = page_of(out)
    assert "timeout: 0 of 2 robots arrived" in page
    assert "The picture shows another run" not in page
    assert (out / "report-worst-1.png").read_bytes().startswith(b"\x89PNG")
    assert 'alt="short, joint-fit, noise low: the ways driven' in page
    file = out / "report-worst-1.yaml"
    assert f"unspoken simulate {file} --goals joint-fit --solver realtime --seed 0" in page
    (run,) = data.runs.values()
    assert load_scenario(file) == run.scenario
    assert run.scenario.sensing.position_noise_m == 0.02


@pytest.fixture
def reported(tmp_path: Path) -> Callable[[Callable[[Run], Row]], str]:
    """The page of an evaluation of one run."""

    def made(figures: Callable[[Run], Row]) -> str:
        write_evaluation(tmp_path / "out", ("short",), figures, goals=("exchanged",))
        assert unspoken_report(tmp_path / "out", "--worst", 3).exit_code == 0
        return page_of(tmp_path / "out")

    return made


def test_it_is_told_when_the_software_drives_otherwise_now(reported):
    told = reported(row)
    assert "The picture shows another run than the evaluation's" in told
    assert "verdict timeout instead of arrived" in told
    assert "steps 5 instead of 60" in told


def test_a_run_that_fails_again_is_drawn_as_far_as_it_came(
    reported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    whole = command.closed_loop

    def breaking(*arguments):
        for moment in whole(*arguments):
            if moment.truth.step == 3:
                raise ArithmeticError("no way")
            yield moment

    monkeypatch.setattr(command, "closed_loop", breaking)
    told = reported(lambda run: Row.without_result(run, "ArithmeticError: no way (x.py:1)"))
    assert "failed: ArithmeticError: no way (x.py:1)" in told
    assert "The picture shows another run" not in told
    assert "The run of the picture ended with" not in told, "it is the same one"
    assert (tmp_path / "out" / "report-worst-1.png").exists()


def test_a_run_that_killed_its_worker_is_not_made_in_this_process(
    reported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(command, "closed_loop", None)
    assert "it might end this process too" in reported(lambda run: Row.without_result(run, DIED))
    assert not (tmp_path / "out" / "report-worst-1.png").exists()


def test_ctrl_c_leaves_no_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    whole, steps = command.closed_loop, []

    def interrupted(*arguments):
        for moment in whole(*arguments):
            steps.append(moment.truth.step)
            if len(steps) == 2:
                signal.raise_signal(signal.SIGINT)
            yield moment

    monkeypatch.setattr(command, "closed_loop", interrupted)
    out = tmp_path / "out"
    write_evaluation(out, ("short",), never, goals=("exchanged", "ioc"))
    result = unspoken_report(out)
    assert result.exit_code == 1
    assert "Interrupted: no report was written" in result.stderr
    assert len(steps) == 2
    assert {path.name for path in out.iterdir()} == {EXPERIMENT, RUNS}
