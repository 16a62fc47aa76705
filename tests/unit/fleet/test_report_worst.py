"""The worst runs: which are chosen, and how they are shown."""

import signal
from pathlib import Path

import pytest
import yaml
from reporting_helpers import never, page_of, row, unspoken_report, write_evaluation

from fleet.evaluate.evaluation import Evaluation
from fleet.evaluate.results import DIED, EXPERIMENT, RUNS, Row
from fleet.evaluate.running import execute
from fleet.inject.scenario import load_scenario
from fleet.report import command, worst
from fleet.report.worst import worst_runs


def made_up(scenario: str, method: str, **figures: object) -> Row:
    key = {"scenario": scenario, "method": method, "solver": "realtime", "noise": "none", "seed": 0}
    plain = {"robots": 2, "verdict": "arrived", "duration_s": 6.0, "collisions": 0, "arrived": 2}
    return Row(**key, **(plain | figures))


def test_failed_runs_come_first_then_collisions_then_robots_that_never_arrive_then_slow_ones():
    rows = [
        made_up("a", "exchanged", duration_s=6.0),
        made_up("a", "ioc", duration_s=9.0),
        made_up("b", "exchanged", duration_s=10.0),
        made_up("b", "ioc", duration_s=12.0),
        made_up("c", "ioc", duration_s=None, verdict="timeout", arrived=1),
        made_up("d", "ioc", duration_s=None, verdict="deadlock", arrived=0),
        made_up("e", "ioc", collisions=1, verdict="collision", minimum_distance_m=0.9),
        made_up("f", "ioc", collisions=1, verdict="collision", minimum_distance_m=0.8),
        made_up("g", "ioc", collisions=2, verdict="collision", minimum_distance_m=0.95),
        Row.without_result(made_up("h", "ioc").key, 2, "ArithmeticError: no way"),
    ]
    told = worst_runs(rows, "exchanged", 20)
    assert [each.row.scenario for each in told[:8]] == ["h", "g", "f", "e", "d", "c", "a", "b"]
    assert [each.why for each in told[:8]] == [
        "failed: ArithmeticError: no way",
        "collision of 2 pairs of robots",
        *["collision of 1 pair of robots"] * 2,
        "deadlock: 0 of 2 robots arrived",
        "timeout: 1 of 2 robots arrived",
        "took 9.0 s, 1.50 times as long as with exchanged",
        "took 12.0 s, 1.20 times as long as with exchanged",
    ]
    assert worst_runs(rows, "exchanged", 2) == told[:2]


def test_without_the_reference_in_a_scenario_the_longest_runs_are_the_worst():
    rows = [made_up("a", "ioc", duration_s=8.0), made_up("b", "ioc", duration_s=9.0)]
    told = worst_runs(rows, "exchanged", 2)
    assert [(each.row.scenario, each.why) for each in told] == [("b", "took 9.0 s"), ("a", "took 8.0 s")]


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Evaluation]:
    """Really driven: two robots with noise that do not get far, and the report."""
    out = tmp_path_factory.mktemp("driven") / "out"
    evaluation = write_evaluation(out, ("short",), execute, goals=("joint-fit",), noise=("low",))
    result = unspoken_report(out, "--worst", 1)
    assert result.exit_code == 0, result.stderr
    return out, evaluation


def test_the_worst_run_is_the_one_that_was_evaluated(driven: tuple[Path, Evaluation]):
    page = page_of(driven[0])
    assert "timeout: 0 of 2 robots arrived" in page.text
    assert "The picture shows another run" not in page.text
    assert len(page.addresses) == 5
    assert (driven[0] / "report-worst-1.png").read_bytes().startswith(b"\x89PNG")
    assert page.alternatives[-1].startswith("short, joint-fit, noise low: the ways driven")


def test_the_told_command_repeats_it_with_its_noise(driven: tuple[Path, Evaluation]):
    out, evaluation = driven
    file = out / "report-worst-1.yaml"
    command = f"unspoken simulate {file} --goals joint-fit --solver realtime --seed 0"
    assert command in page_of(out).text
    (run,) = evaluation.runs()
    assert load_scenario(file) == run.scenario
    assert yaml.safe_load(file.read_text())["sensing"]["position_noise_m"] == 0.02


def test_it_is_told_when_the_software_drives_otherwise_now(tmp_path: Path):
    write_evaluation(tmp_path / "out", ("short",), row, goals=("exchanged",))
    assert unspoken_report(tmp_path / "out", "--worst", 1).exit_code == 0
    told = page_of(tmp_path / "out").text
    assert "The picture shows another run than the evaluation's" in told
    assert "verdict timeout instead of arrived" in told
    assert "steps 5 instead of 60" in told


def test_a_run_that_fails_again_is_drawn_as_far_as_it_came(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    whole = worst.closed_loop

    def breaking(*arguments):
        for moment in whole(*arguments):
            if moment.truth.step == 3:
                raise ArithmeticError("no way")
            yield moment

    monkeypatch.setattr(worst, "closed_loop", breaking)
    out = tmp_path / "out"
    write_evaluation(
        out,
        ("short",),
        lambda run: Row.without_result(run.key, 2, "ArithmeticError: no way (x.py:1)"),
        goals=("ioc",),
    )
    assert unspoken_report(out, "--worst", 1).exit_code == 0
    page = page_of(out)
    assert "failed: ArithmeticError: no way (x.py:1)" in page.text
    assert "The picture shows another run" not in page.text
    assert "The run of the picture ended with" not in page.text, "it is the same one"
    assert (out / "report-worst-1.png").exists()


def test_a_run_that_killed_its_worker_is_not_made_in_this_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(worst, "closed_loop", None)
    out = tmp_path / "out"
    write_evaluation(out, ("short",), lambda run: Row.without_result(run.key, 2, DIED), goals=("ioc",))
    assert unspoken_report(out, "--worst", 1).exit_code == 0
    assert "it might end this process too" in page_of(out).text
    assert not (out / "report-worst-1.png").exists()


def test_ctrl_c_leaves_no_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    whole, steps = worst.closed_loop, []

    def interrupted(*arguments):
        for moment in whole(*arguments):
            steps.append(moment.truth.step)
            if len(steps) == 2:
                signal.raise_signal(signal.SIGINT)
            yield moment

    monkeypatch.setattr(worst, "closed_loop", interrupted)
    out = tmp_path / "out"
    write_evaluation(out, ("short",), never, goals=("exchanged", "ioc"))
    result = unspoken_report(out)
    assert result.exit_code == 1
    assert "Interrupted: no report was written" in result.stderr
    assert len(steps) == 2
    assert {path.name for path in out.iterdir()} == {EXPERIMENT, RUNS}


def test_a_disk_that_takes_nothing_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(path: Path, _content: object) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(command, "write_whole", full)
    write_evaluation(tmp_path / "out", ("short",), row)
    result = unspoken_report(tmp_path / "out", "--worst", 0)
    assert result.exit_code == 3
    assert "report-duration.png: cannot be written: No space left on device" in result.stderr
    assert not (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize("count", [0, 1, 3])
def test_so_many_are_shown_as_are_asked_for_and_there_are(
    tmp_path: Path, count: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(worst, "closed_loop", lambda *_: iter(()))
    out = tmp_path / "out"
    write_evaluation(out, ("short",), never, goals=("exchanged", "ioc"))
    assert unspoken_report(out, "--worst", count).exit_code == 0
    assert len(list(out.glob("report-worst-*.png"))) == min(count, 2)
