"""``unspoken evaluate`` as a person and as a script see it; the runs are made in this process."""

import signal
from concurrent.futures import Future
from pathlib import Path

import pytest
from distributed import KilledWorker
from evaluation_helpers import InThisProcess, unspoken_evaluate, use, write_suite

from agent.estimate import DEFAULT_GOALS
from agent.process import options
from fleet.evaluate import running
from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import Row, read_rows


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    return write_suite(tmp_path / "suite", "one", "two")


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    """Runs that were made; they are made up, and that of ``two`` with ioc raises."""
    runs = []

    def drive(run: Run) -> Row:
        runs.append(run)
        if (run.key.scenario, run.goals) == ("two", "ioc"):
            raise ArithmeticError("no way")
        duration_s = 8.0 if run.goals == "ioc" else 6.0
        return Row(**run.key._asdict(), robots=2, verdict="arrived", duration_s=duration_s, collisions=0)

    monkeypatch.setattr(running, "_drive", drive)
    monkeypatch.setattr(running, "make_ready", lambda *_: None)
    use(monkeypatch, InThisProcess())
    return runs


def line_of(output: str, method: str) -> list[str]:
    (line,) = [line for line in output.splitlines() if line.split()[:1] == [method]]
    return line.split()


def test_a_failed_run_is_a_row_and_the_others_are_made(suite: Path, tmp_path: Path, driven: list[Run]):
    result = unspoken_evaluate(suite, "--goals", "exchanged,ioc", "--out", tmp_path / "out")
    assert result.exit_code == 3
    rows = {(row.scenario, row.method): row for row in read_rows(tmp_path / "out")}
    assert len(rows) == len(driven) == 4
    failed = rows.pop(("two", "ioc"))
    assert failed.verdict == "failed"
    assert failed.reason.startswith("ArithmeticError: no way (test_evaluation_command.py:")
    assert {row.verdict for row in rows.values()} == {"arrived"}
    assert line_of(result.stdout, "exchanged") == ["exchanged", "none", "2", "2", "0", "0", "6", "–", "–"]
    assert line_of(result.stdout, "ioc") == ["ioc", "none", "2", "1", "0", "1", "8", "–", "–"]


def test_the_same_command_repeats_no_run(suite: Path, tmp_path: Path, driven: list[Run]):
    command = (suite, "--goals", "exchanged", "--out", tmp_path / "out")
    assert unspoken_evaluate(*command).exit_code == 0
    kept = (tmp_path / "out" / "runs.csv").read_bytes()
    again = unspoken_evaluate(*command)
    assert again.exit_code == 0
    assert "2 of 2 runs are there already" in again.stderr
    assert line_of(again.stdout, "exchanged")[2] == "2"
    assert len(driven) == 2
    assert (tmp_path / "out" / "runs.csv").read_bytes() == kept


def test_an_interruption_keeps_what_is_done_and_the_same_command_makes_the_rest(
    suite: Path, tmp_path: Path, driven: list[Run], monkeypatch: pytest.MonkeyPatch
):
    command = (suite, "--goals", "exchanged,constant-acceleration", "--out", tmp_path / "out")

    class Interrupting(Future):
        def result(self, timeout=None):
            signal.raise_signal(signal.SIGINT)
            return super().result(timeout)

    class Interrupted(InThisProcess):
        def submit(self, function, run, **options):
            future = super().submit(function, run, **options)
            if run.key[:2] == ("two", "exchanged"):
                result, future = future.result(), Interrupting()
                future.set_result(result)
            return future

    use(monkeypatch, Interrupted())
    first = unspoken_evaluate(*command)
    assert first.exit_code == 1
    assert f"3 of 4 runs are kept; to make the others give the same command with --out {tmp_path}" in (
        first.stderr
    )
    kept = read_rows(tmp_path / "out")
    assert len(kept) == 3
    driven.clear()
    use(monkeypatch, InThisProcess())
    assert unspoken_evaluate(*command).exit_code == 0
    assert [run.key for run in driven] == [("two", "constant-acceleration", "realtime", "none", 0)]
    assert read_rows(tmp_path / "out")[:3] == kept


def test_a_run_that_kills_its_worker_each_time_has_failed(
    suite: Path, tmp_path: Path, driven: list[Run], monkeypatch: pytest.MonkeyPatch
):
    class Deadly(InThisProcess):
        def submit(self, function, run, **options):
            def die(_run: Run) -> Row:
                raise KilledWorker("execute", None, 3)

            return super().submit(die if run.key.scenario == "one" else function, run, **options)

    use(monkeypatch, Deadly())
    assert unspoken_evaluate(suite, "--goals", "exchanged", "--out", tmp_path / "out").exit_code == 3
    told = {row.scenario: row.reason for row in read_rows(tmp_path / "out")}
    assert told == {"one": "the worker process died each time that this was tried", "two": None}


def test_a_cluster_that_has_gone_fails_no_run(
    suite: Path, tmp_path: Path, driven: list[Run], monkeypatch: pytest.MonkeyPatch
):
    class Gone(InThisProcess):
        status = "closed"

    use(monkeypatch, Gone())
    result = unspoken_evaluate(suite, "--goals", "exchanged", "--out", tmp_path / "out")
    assert result.exit_code == 3
    assert "the Dask cluster has gone" in result.stderr
    assert read_rows(tmp_path / "out") == []


def test_a_directory_of_a_different_evaluation_is_refused(suite: Path, tmp_path: Path, driven: list[Run]):
    assert unspoken_evaluate(suite, "--goals", "exchanged", "--out", tmp_path / "out").exit_code == 0
    kept = (tmp_path / "out" / "runs.csv").read_bytes()
    refused = unspoken_evaluate(suite, "--goals", "ioc", "--out", tmp_path / "out")
    assert refused.exit_code == 2
    assert "goals: exchanged there, ioc here" in refused.stderr
    assert len(driven) == 2
    assert (tmp_path / "out" / "runs.csv").read_bytes() == kept


def test_it_is_told_where_one_seed_stands_for_several(suite: Path, tmp_path: Path, driven: list[Run]):
    command = (suite, "--goals", "exchanged", "--seeds", 3, "--noise", "none,low", "--out", tmp_path / "out")
    told = unspoken_evaluate(*command).stderr
    assert "Without noise all seeds give the same run: seed 0 only for 2 of 4 scenarios" in told
    assert len(driven) == 2 * 1 + 2 * 3


def test_baselines_are_rows_of_the_same_table(suite: Path, tmp_path: Path, driven: list[Run]):
    baselines = ("constant-acceleration-alone", "constant-velocity", "orca")
    result = unspoken_evaluate(suite, "--goals", ",".join(baselines), "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert len(driven) == 6
    for method in baselines:
        assert line_of(result.stdout, method) == [method, "none", "2", "2", "0", "0", "6", "–", "–"]


def test_by_default_the_estimators_are_compared_and_no_baseline(
    suite: Path, tmp_path: Path, driven: list[Run]
):
    unspoken_evaluate(suite, "--out", tmp_path / "out")
    assert {run.goals for run in driven} == {"exchanged", "ioc", "constant-acceleration", DEFAULT_GOALS}


def test_a_baseline_that_cannot_be_used_is_told_before_anything_is_run(
    suite: Path, tmp_path: Path, driven: list[Run], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(options, "is_available", lambda: False)
    result = unspoken_evaluate(suite, "--goals", "exchanged,orca", "--out", tmp_path / "out")
    assert result.exit_code == 2
    told = " ".join(result.stderr.replace("│", " ").split())
    assert "--goals" in told
    assert "orca needs the library pyrvo" in told
    assert driven == []
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--goals", "exchanged,psychic"), "'psychic' found, one or more of exchanged, ioc"),
        (("--goals", ""), "'' found"),
        (("--noise", "deafening"), "'deafening' found, one of low, medium, high or FIELD=VALUE"),
        (("--seeds", 0), "--seeds"),
        (("--workers", 2, "--dask", "tcp://127.0.0.1:1"), "leave out one of"),
    ],
)
def test_wrong_usage_is_refused(suite: Path, tmp_path: Path, arguments: tuple[object, ...], told: str):
    result = unspoken_evaluate(suite, *arguments, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.replace("│", " ").split())
    assert not (tmp_path / "out").exists()


def test_a_suite_that_does_not_exist_is_refused(tmp_path: Path):
    result = unspoken_evaluate("no-such-suite", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "no-such-suite: there is no such file" in result.stderr
