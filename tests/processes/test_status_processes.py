"""``unspoken status`` beside real runs."""

import json
import os
import pty
import signal
import stat
import subprocess
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from process_helpers import PATIENCE_S, UNSPOKEN, Bench, Process, endless, lanes, until, write_scenario

from fleet.record.address import FILE
from protocol.identity import new_passwords, write_password, write_users

Start = Callable[..., Process]


def status(*arguments: object, cwd: Path | None = None) -> tuple[int, str, str]:
    ran = subprocess.run(
        [UNSPOKEN, "status", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=PATIENCE_S,
    )
    assert "Traceback" not in ran.stderr
    return ran.returncode, ran.stdout, ran.stderr


def look(out: Path) -> dict[str, Any]:
    exit_status, said, complained = status(out, "--once", "--json")
    assert exit_status == 0, complained
    [line] = said.splitlines()
    found: dict[str, Any] = json.loads(line)
    return found


def states(found: dict[str, Any]) -> dict[str, str]:
    return {robot["robot"]: robot["state"] for robot in found["robots"]}


@pytest.mark.slow
def test_a_run_can_be_looked_at_while_it_goes_on_and_not_after(
    bench: Callable[..., Bench], tmp_path: Path, temporary: Path
) -> None:
    run = bench("run", "run", endless(tmp_path / "endless.yaml", 2), "--restart", "never")
    run.reach(5)
    found = look(run.out)
    assert states(found) == {"1": "ready", "2": "ready"}
    assert found["world"]["state"] == "drives"
    assert found["world"]["rate_hz"] > 1.0
    for robot in found["robots"]:
        assert 0.0 < robot["decide_ms"]["p50"] <= robot["decide_ms"]["p99"]
        assert robot["lag_ms"]["p50"] > 0.0
    way = run.out / FILE
    assert stat.S_IMODE(way.stat().st_mode) == 0o600
    assert stat.S_IMODE(Path(json.loads(way.read_text())["password_file"]).stat().st_mode) == 0o600
    run.kill("agent", robot="2")
    assert states(look(run.out)) == {"1": "ready", "2": "lost"}
    exit_status, table, _ = status(run.out)  # no terminal: once
    assert exit_status == 0
    assert [line.split()[:2] for line in table.splitlines()[2:]] == [["1", "ready"], ["2", "lost"]]
    run.signal(signal.SIGINT)
    run.end()
    assert not way.exists()
    exit_status, _, complained = status(run.out)
    assert (exit_status, complained.count("\n")) == (1, 1)
    assert "this run has ended" in complained


@pytest.mark.slow
def test_who_follows_a_run_sees_its_verdict_and_does_not_hold_it_up(
    bench: Callable[..., Bench], process: Start, tmp_path: Path
) -> None:
    run = bench("run", "run", endless(tmp_path / "endless.yaml", 1))
    run.reach(2)
    follows = process("status", "status", run.out, "--json")
    follows.tells('"state":"ready"')
    run.signal(signal.SIGINT)
    assert follows.end() == 0
    assert json.loads(follows.told.splitlines()[-1])["world"]["verdict"] == "interrupted"
    assert run.end() == 1


@pytest.mark.slow
def test_on_a_terminal_the_table_is_live_until_ctrl_c(bench: Callable[..., Bench], tmp_path: Path) -> None:
    run = bench("run", "run", endless(tmp_path / "endless.yaml", 2))
    run.reach(2)
    terminal, theirs = pty.openpty()
    seen = bytearray()
    with subprocess.Popen(
        [UNSPOKEN, "status", run.out],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100", "LINES": "30"},
    ) as live:
        os.close(theirs)

        def read() -> None:
            with suppress(OSError):  # the end of a terminal whose last user has gone
                while more := os.read(terminal, 65536):
                    seen.extend(more)

        reading = threading.Thread(target=read)
        reading.start()
        try:
            until(lambda: seen.count(b"steps/s") >= 3 and b"ready" in seen, "a table that is drawn anew")
            live.send_signal(signal.SIGINT)
            assert live.wait(PATIENCE_S) == 0
        finally:
            live.kill()
            reading.join(PATIENCE_S)
            os.close(terminal)
    assert b"Traceback" not in seen
    assert run.running


@pytest.mark.slow
def test_a_world_elsewhere_tells_who_is_missing_and_lets_only_the_bench_look(
    process: Start, tmp_path: Path, temporary: Path
) -> None:
    endpoint, users = f"unixsock-stream/{temporary}/w", temporary / "users"
    passwords = new_passwords(["@bench", "1", "2"])
    write_users(users, passwords)
    for name, password in passwords.items():
        write_password(temporary / f"{name}.password", password)
    scenario = write_scenario(tmp_path / "two.yaml", lanes(2, 4.0))
    told = ["--scenario", scenario, "--listen", endpoint, "--users", users, "--run", "here"]
    world = process("world", "world", *told, "--start-timeout", 600)
    world.tells("waiting for robots")
    agent = process(
        "agent",
        *("agent", "--robot", "1", "--goal", "4,0,0", "--connect", endpoint, "--run", "here"),
        *("--password-file", temporary / "1.password"),
    )
    world.tells("missing=2 ")
    at = ("--connect", endpoint, "--run", "here", "--once", "--json")
    exit_status, said, complained = status(*at, "--password-file", temporary / "@bench.password")
    assert exit_status == 0, complained
    found = json.loads(said)
    assert found["world"]["state"] == "waits"
    assert states(found) == {"1": "present", "2": "missing"}
    exit_status, said, complained = status(*at, "--password-file", temporary / "1.password")
    assert (exit_status, said) == (3, "")
    assert "refuses us" in complained
    exit_status, said, complained = status(*at)
    assert (exit_status, said) == (3, "")
    wrong_run = ("--connect", endpoint, "--run", "there", "--once")
    exit_status, said, complained = status(*wrong_run, "--password-file", temporary / "@bench.password")
    assert (exit_status, said) == (3, "")
    assert "does not answer for a run 'there'" in complained
    agent.signal(signal.SIGTERM)
    assert agent.end() == 0
