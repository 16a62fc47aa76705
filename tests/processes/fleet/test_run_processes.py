"""Processes are started with their settings, watched, and ended by their ids."""

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fleet.run import processes as processes_module
from fleet.run.processes import Processes

PATIENCE_S = 60.0
"""How long a test waits for what should come; only reached when it fails."""

OBEDIENT = "import signal; print('ready'); signal.pause()"
STUBBORN = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready'); signal.pause()"
TALKATIVE = (
    "import sys; [print(f'line {i}') for i in range(20)]; print('no such goal', file=sys.stderr); sys.exit(4)"
)
TELLING = "import json, os; print(json.dumps(dict(os.environ)))"


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of modules that can be started."""
    folder = tmp_path / "modules"
    folder.mkdir()
    for name, text in {
        "obedient": OBEDIENT,
        "stubborn": STUBBORN,
        "talkative": TALKATIVE,
        "telling": TELLING,
    }.items():
        (folder / f"{name}.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return folder


@pytest.fixture
def processes(tmp_path: Path, modules: Path) -> Iterator[Processes]:
    logs = tmp_path / "logs"
    logs.mkdir()
    with Processes(logs) as processes:
        yield processes


def logged(processes: Processes, name: str, text: str) -> str:
    """The log of a process once it holds a text."""
    give_up_s = time.monotonic() + PATIENCE_S
    while text not in (log := processes.log_file(name).read_text()):
        assert time.monotonic() < give_up_s, log
        time.sleep(0.01)
    return log


def ended(processes: Processes, name: str) -> str:
    """How a process ended, once it has."""
    give_up_s = time.monotonic() + PATIENCE_S
    while name not in processes.ended():
        assert time.monotonic() < give_up_s
        time.sleep(0.01)
    return processes.ended()[name]


def test_a_process_gets_its_settings_and_nobody_elses(
    processes: Processes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UNSPOKEN_GOAL", "1,2,3")
    monkeypatch.setenv("WEATHER", "fair")
    processes.start("robot-1", "telling", {"robot": "1", "run": "hall"})
    told = json.loads(logged(processes, "robot-1", "}"))
    settings = {name: value for name, value in told.items() if name.startswith("UNSPOKEN_")}
    assert settings == {
        "UNSPOKEN_ROBOT": "1",
        "UNSPOKEN_RUN": "hall",
        "UNSPOKEN_PARENT": str(os.getpid()),
    }
    assert told["WEATHER"] == "fair"


def test_a_module_where_the_user_stands_is_not_started(
    processes: Processes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "telling.py").write_text("print('{wrong one}')")
    monkeypatch.chdir(tmp_path)
    processes.start("robot-1", "telling", {})
    assert "wrong" not in logged(processes, "robot-1", "}")


def test_the_account_of_a_process_that_ended_tells_how_and_its_last_words(processes: Processes) -> None:
    processes.start("robot-1", "talkative", {})
    account = ended(processes, "robot-1")
    assert account.startswith("robot-1 ended with exit status 4 before the run was over")
    assert str(processes.log_file("robot-1")) in account
    last = account.splitlines()[1:]
    assert len(last) == processes_module.LOG_TAIL_LINES
    assert "  no such goal" in last
    assert "  line 19" in last
    assert "  line 1" not in last


def test_the_account_of_a_killed_process_names_the_signal(processes: Processes) -> None:
    processes.start("world", "obedient", {})
    logged(processes, "world", "ready")
    assert processes.ended() == {}
    processes.ask_to_end("world")
    assert ended(processes, "world").startswith("world was killed by signal 15")


@pytest.mark.parametrize("module", ["obedient", "stubborn"])
def test_no_process_outlives_the_block(
    module: str, tmp_path: Path, modules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes_module, "PATIENCE_S", 0.2)
    with Processes(tmp_path) as processes:
        for name in ("one", "two"):
            processes.start(name, module, {})
        for name in ("one", "two"):
            logged(processes, name, "ready")
    number = 15 if module == "obedient" else 9
    accounts = processes.ended()
    assert set(accounts) == {"one", "two"}
    assert all(f"was killed by signal {number} " in account for account in accounts.values())


def test_ctrl_c_in_the_terminal_does_not_reach_the_processes(processes: Processes) -> None:
    """It goes to the foreground process group; they have groups of their own."""
    processes.start("world", "obedient", {})
    logged(processes, "world", "ready")
    [group] = [
        int(stat.read_text().rpartition(")")[2].split()[2])
        for stat in Path("/proc").glob("[0-9]*/stat")
        if (stat.parent / "cmdline").read_text().endswith("obedient\0")
        and int(stat.read_text().rpartition(")")[2].split()[1]) == os.getpid()
    ]
    assert group != os.getpgrp()
