"""Processes are watched, and ended by their ids."""

import os
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from process_helpers import until

from fleet.run import processes as processes_module
from fleet.run.processes import Processes

MODULES = {
    "stubborn": "import signal; signal.signal(15, signal.SIG_IGN); print('ready'); signal.pause()",
    "talkative": "import sys; [print(f'line {i}') for i in range(20)]; sys.exit('no such goal')",
}


@pytest.fixture
def processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Processes]:
    """For modules of this test's, with little patience."""
    for name, text in MODULES.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(processes_module, "PATIENCE_S", 0.2)
    with Processes(tmp_path) as processes:
        yield processes


def test_the_account_of_a_process_that_ended_tells_how_and_its_last_words(processes: Processes) -> None:
    processes.start("robot-1", "talkative", {})
    until(lambda: "robot-1" in processes.ended(), "its end")
    account = processes.ended()["robot-1"]
    assert account.startswith("robot-1 ended with exit status 1 before the run was over")
    assert str(processes.log_file("robot-1")) in account
    last = account.splitlines()[1:]
    assert len(last) == processes_module.LOG_TAIL_LINES
    assert "  no such goal" in last
    assert "  line 19" in last
    assert "  line 1" not in last


def test_ctrl_c_does_not_reach_the_processes_and_not_even_a_stubborn_one_outlives_the_block(
    processes: Processes,
) -> None:
    """Ctrl-C goes to the foreground process group of the terminal; they have groups of their own."""
    for name in ("one", "two"):
        processes.start(name, "stubborn", {})
        until(lambda name=name: "ready" in processes.log_file(name).read_text(), "its start")
    children = [each.pid for each in psutil.Process().children() if each.cmdline()[-1] == "stubborn"]
    assert len(children) == 2
    assert os.getpgrp() not in map(os.getpgid, children)
    processes.__exit__()
    accounts = processes.ended()
    assert set(accounts) == {"one", "two"}
    assert all("was killed by signal 9 " in account for account in accounts.values())
