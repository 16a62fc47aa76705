"""Evaluations on real worker processes: interrupted, robbed of a worker, and on a Dask cluster."""

import os
import re
import signal
import sys
from pathlib import Path

import psutil
import pytest
from distributed import Client
from process_helpers import PATIENCE_S, Process, endless, ends_all, until

from fleet.evaluate.results import RUNS, read_evaluation, read_rows
from fleet.evaluate.running import execute

DASK = Path(sys.executable).with_name("dask")
MADE_BY_CHANCE = re.compile(r"_cpu_|^cpu_s$|^wall_s$")
"""Columns that differ from one time to the other."""

pytestmark = pytest.mark.slow


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


def test_an_evaluation_listens_on_loopback_ends_at_ctrl_c_is_resumed_and_survives_a_worker(tmp_path, process):
    out = tmp_path / "out"
    command = ("evaluate", "2-crossing", "--out", out, "--goals", "exchanged", "--noise", "low")
    command = (*command, "--seeds", 5, "--workers", 1)
    first = process("first", *command)
    has_rows(out, 1)
    children = first.children()
    assert listened_at([first.own_pid, *workers_of(first)]) == {"127.0.0.1"}
    for pid in children:  # a terminal sends it to all of them
        os.kill(pid, signal.SIGINT)
    first.signal(signal.SIGINT)
    assert first.end() == 1, first.complained
    assert (
        f"of 5 runs are kept; to make the others give the same command with --out {out}" in first.complained
    )
    assert "Traceback" not in first.complained
    ends_all(children)
    kept, count = (out / RUNS).read_bytes(), len(read_rows(out))
    assert 1 <= count < 5
    second = process("second", *command)
    has_rows(out, count + 1)
    for worker in workers_of(second):
        os.kill(worker, signal.SIGKILL)
    assert second.end() == 0, second.complained
    assert (out / RUNS).read_bytes().startswith(kept)
    assert sorted((row.seed, row.verdict) for row in read_rows(out)) == [(i, "arrived") for i in range(5)]


def test_an_existing_dask_cluster_makes_the_runs_and_fails_none_when_it_dies(tmp_path, process):
    def dask(name: str, *arguments: object) -> Process:
        local = ("--host", "127.0.0.1", "--no-dashboard")
        return process(name, *arguments, *local, program=(DASK,), cwd=tmp_path, env={"TMPDIR": tmp_path})

    scheduler = dask("scheduler", "scheduler", "--port", 0)
    until(lambda: "Scheduler at:" in scheduler.complained, "the scheduler")
    [address] = re.findall(r"Scheduler at:\s+(tcp://\S+)", scheduler.complained)
    for name in ("one", "two"):
        dask(name, "worker", address, "--nthreads", 1, "--no-nanny", "--name", name)
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=PATIENCE_S)
        out = tmp_path / "out"
        command = ("--goals", "exchanged,constant-acceleration", "--noise", "low", "--seeds", 2)
        evaluation = process("told", "evaluate", "2-crossing", "--out", out, *command, "--dask", address)
        assert evaluation.end() == 0, evaluation.complained
        assert workers_of(evaluation) == []
        assert have_made_runs(client) == [True, True]
        assert driven(read_rows(out)) == driven(map(execute, read_evaluation(out).runs()))

        lost, suite = tmp_path / "lost", endless(tmp_path / "endless.yaml", 2)
        command = ("--goals", "exchanged", "--dask", address, "--out", lost)
        evaluation = process("evaluation", "evaluate", suite, *command)
        until(lambda: any(client.processing().values()), "the beginning of the run")
    scheduler.signal(signal.SIGKILL)
    assert evaluation.end() == 3
    assert "the Dask cluster has" in evaluation.complained
    assert "Traceback" not in evaluation.complained
    assert read_rows(lost) == []


def test_without_a_scheduler_there_nothing_is_run(tmp_path: Path, process):
    evaluation = process(
        "told", "evaluate", "2-crossing", "--out", tmp_path / "out", "--dask", "tcp://127.0.0.1:9"
    )
    assert evaluation.end() == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in evaluation.complained
    assert "Traceback" not in evaluation.complained
