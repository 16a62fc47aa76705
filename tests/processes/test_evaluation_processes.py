"""Evaluations on real worker processes: interrupted, robbed of a worker, and on a Dask cluster."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest
from distributed import Client
from process_helpers import PATIENCE_S, Process, endless, is_alive, until

from fleet.evaluate.results import RUNS, read_evaluation, read_rows
from fleet.evaluate.running import execute

DASK = Path(sys.executable).with_name("dask")
MADE_BY_CHANCE = re.compile(r"_cpu_|^cpu_s$|^wall_s$")
"""Columns that differ from one time to the other."""


def evaluate(process, out: Path, *arguments: object) -> Process:
    return process("told", "evaluate", "2-crossing", "--out", out, *arguments)


def has_rows(out: Path, count: int) -> None:
    """Wait until so many runs are kept."""
    until(lambda: (out / RUNS).exists() and len((out / RUNS).read_bytes().splitlines()) > count, "a row")


def workers_of(process: Process) -> list[int]:
    return [pid for pid, line in process.children().items() if any("spawn_main" in part for part in line)]


def have_made_runs(client: Client) -> list[bool]:
    """Each worker of a cluster."""
    return list(client.run(lambda: "fleet.evaluate.running" in sys.modules).values())


def driven(rows) -> dict[object, dict[str, object]]:
    """What was driven, by run, without how long it took to compute."""
    return {row.key: {name: value for name, value in row if not MADE_BY_CHANCE.search(name)} for row in rows}


def listened_at(pids: list[int]) -> set[str]:
    """The addresses at which these processes take connections."""
    sockets = [each for pid in pids for each in psutil.Process(pid).net_connections(kind="inet")]
    return {each.laddr.ip for each in sockets if each.status == psutil.CONN_LISTEN}


def test_an_evaluation_listens_on_loopback_ends_at_ctrl_c_and_is_resumed(tmp_path: Path, process):
    out = tmp_path / "out"
    command = ("--goals", "exchanged", "--noise", "low", "--seeds", 4, "--workers", 1)
    first = evaluate(process, out, *command)
    has_rows(out, 1)
    children = first.children()
    assert listened_at([first.own_pid, *workers_of(first)]) == {"127.0.0.1"}
    for pid in children:  # a terminal sends it to all of them
        os.kill(pid, signal.SIGINT)
    first.signal(signal.SIGINT)
    assert first.end() == 1, first.complained
    assert f"of 4 runs are kept; to make the others give the same command with --out {out}" in (
        first.complained
    )
    assert "Traceback" not in first.complained
    until(lambda: not any(map(is_alive, children)), "the end of all processes")
    kept = (out / RUNS).read_bytes()
    assert 1 <= len(read_rows(out)) < 4
    second = evaluate(process, out, *command)
    assert second.end() == 0, second.complained
    assert (out / RUNS).read_bytes().startswith(kept)
    assert sorted(row.seed for row in read_rows(out)) == [0, 1, 2, 3]


@pytest.mark.slow
def test_the_run_of_a_worker_that_dies_is_made_again(tmp_path: Path, process):
    out = tmp_path / "out"
    evaluation = evaluate(
        process, out, "--goals", "exchanged", "--noise", "low", "--seeds", 3, "--workers", 1
    )
    has_rows(out, 1)
    (worker,) = workers_of(evaluation)
    os.kill(worker, signal.SIGKILL)
    assert evaluation.end() == 0, evaluation.complained
    assert sorted((row.seed, row.verdict) for row in read_rows(out)) == [(i, "arrived") for i in range(3)]


class DaskProcess:
    """One ``dask …`` on loopback; ended by its id."""

    def __init__(self, directory: Path, *arguments: object) -> None:
        directory.mkdir()
        self._stderr = directory / "stderr"
        with self._stderr.open("wb") as stderr:
            self._process = subprocess.Popen(
                [str(DASK), *map(str, arguments), "--host", "127.0.0.1", "--no-dashboard"],
                cwd=directory,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                env={**os.environ, "PYTHONUNBUFFERED": "1", "TMPDIR": str(directory)},
            )

    def __enter__(self) -> "DaskProcess":
        return self

    def __exit__(self, *_error: object) -> None:
        self.kill()

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def tells(self, pattern: str) -> str:
        """Wait until it logs something of this form; the part in brackets."""

        def found() -> re.Match[str] | None:
            return re.search(pattern, self._stderr.read_text(encoding="utf-8"))

        until(lambda: found() is not None or self._process.poll() is not None, pattern)
        match = found()
        assert match is not None, self._stderr.read_text(encoding="utf-8")
        return match[1]


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[DaskProcess]:
    with DaskProcess(tmp_path / "scheduler", "scheduler", "--port", 0) as process:
        yield process


@pytest.fixture
def cluster(tmp_path: Path, scheduler: DaskProcess) -> Iterator[str]:
    """The address of a scheduler with two workers."""
    address = scheduler.tells(r"Scheduler at:\s+(tcp://\S+)")
    with ExitStack() as processes:
        for name in ("one", "two"):
            worker = ("worker", address, "--nthreads", 1, "--no-nanny", "--name", name)
            processes.enter_context(DaskProcess(tmp_path / name, *worker))
        yield address


@pytest.mark.slow
def test_an_existing_dask_cluster_makes_the_runs(tmp_path: Path, process, cluster: str):
    with Client(cluster, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=PATIENCE_S)
        out = tmp_path / "out"
        command = ("--goals", "exchanged,constant-acceleration", "--noise", "low", "--seeds", 2)
        evaluation = evaluate(process, out, *command, "--dask", cluster)
        assert evaluation.end() == 0, evaluation.complained
        assert workers_of(evaluation) == []
        assert have_made_runs(client) == [True, True]
    assert driven(read_rows(out)) == driven(map(execute, read_evaluation(out).runs()))


def test_a_cluster_that_dies_fails_no_run(tmp_path: Path, process, scheduler: DaskProcess, cluster: str):
    out = tmp_path / "out"
    suite = endless(tmp_path / "endless.yaml", 2)
    evaluation = process("told", "evaluate", suite, "--goals", "exchanged", "--dask", cluster, "--out", out)
    with Client(cluster, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=PATIENCE_S)
        until(lambda: any(have_made_runs(client)), "the beginning of the run")
    scheduler.kill()
    assert evaluation.end() == 3
    assert "the Dask cluster has" in evaluation.complained
    assert "Traceback" not in evaluation.complained
    assert read_rows(out) == []


@pytest.mark.slow
def test_without_a_scheduler_there_nothing_is_run(tmp_path: Path, process):
    evaluation = evaluate(process, tmp_path / "out", "--dask", "tcp://127.0.0.1:9")
    assert evaluation.end() == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in evaluation.complained
    assert "Traceback" not in evaluation.complained
