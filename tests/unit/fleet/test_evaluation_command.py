"""``unspoken evaluate`` as a person and as a script see it; the runs are made up."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from distributed import KilledWorker
from evaluation_helpers import InThisProcess, unspoken_evaluate, use, write_suite

from agent.estimate import DEFAULT_GOALS
from agent.process import options
from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import Row, read_rows


@pytest.fixture
def evaluate(tmp_path: Path) -> Callable[..., Result]:
    """Evaluates two scenarios in ``out``."""
    suite = write_suite(tmp_path / "suite", "one", "two")
    return lambda *arguments: unspoken_evaluate(suite, *arguments, "--out", tmp_path / "out")


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    """Runs that were made."""
    runs = []

    def drive(run: Run) -> Row:
        runs.append(run)
        return arrived(run)

    use(monkeypatch, InThisProcess(drive))
    return runs


def arrived(run: Run) -> Row:
    duration_s = 8.0 if run.key.method == "ioc" else 6.0
    return Row(**run.key._asdict(), robots=2, verdict="arrived", duration_s=duration_s, collisions=0)


def line_of(output: str, method: str) -> list[str]:
    (line,) = [line for line in output.splitlines() if line.split()[:1] == [method]]
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


def test_the_same_command_repeats_no_run(evaluate: Any, tmp_path: Path, driven: list[Run]):
    assert evaluate("--goals", "exchanged").exit_code == 0
    kept = (tmp_path / "out" / "runs.csv").read_bytes()
    again = evaluate("--goals", "exchanged")
    assert again.exit_code == 0
    assert "2 of 2 runs are there already" in again.stderr
    assert line_of(again.stdout, "exchanged")[2] == "2"
    assert len(driven) == 2
    assert (tmp_path / "out" / "runs.csv").read_bytes() == kept


def test_a_cluster_that_has_gone_fails_no_run(
    evaluate: Any, tmp_path: Path, driven: list[Run], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(InThisProcess, "status", "closed")
    result = evaluate("--goals", "exchanged")
    assert result.exit_code == 3
    assert "the Dask cluster has gone" in result.stderr
    assert read_rows(tmp_path / "out") == []


def test_by_default_the_estimators_are_compared_and_no_baseline_but_baselines_can_be(
    evaluate: Any, driven: list[Run], tmp_path: Path
):
    evaluate()
    assert {run.key.method for run in driven} == {"exchanged", "ioc", "constant-acceleration", DEFAULT_GOALS}
    suite, baselines = tmp_path / "suite", "constant-acceleration-alone,constant-velocity,orca"
    result = unspoken_evaluate(suite, "--goals", baselines, "--out", tmp_path / "other")
    assert result.exit_code == 0
    assert [line_of(result.stdout, method)[2] for method in baselines.split(",")] == ["2", "2", "2"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--goals", "exchanged,psychic"), "'psychic' found, one or more of exchanged, ioc"),
        (("--goals", ""), "'' found"),
        (("--goals", "exchanged,orca"), "orca needs the library pyrvo"),
        (("--noise", "deafening"), "'deafening' found, one of low, medium, high or FIELD=VALUE"),
        (("--seeds", 0), "--seeds"),
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
