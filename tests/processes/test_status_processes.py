"""``unspoken status`` beside real runs."""

import json
import os
import pty
import signal
import stat
import subprocess
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from process_helpers import PATIENCE_S, UNSPOKEN, endless, lanes, until, write_scenario

from fleet.run.launch import FILE
from protocol.identity import new_passwords, write_password, write_users

pytestmark = pytest.mark.slow


def status(*arguments: object) -> tuple[int, str, str]:
    command = [UNSPOKEN, "status", *map(str, arguments)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert "Traceback" not in ran.stderr
    return ran.returncode, ran.stdout, ran.stderr


def look(*arguments: object) -> dict[str, Any]:
    exit_status, said, complained = status(*arguments, "--once", "--json")
    assert exit_status == 0, complained
    [line] = said.splitlines()
    found: dict[str, Any] = json.loads(line)
    return found


def states(found: dict[str, Any]) -> dict[str, str]:
    return {robot["robot"]: robot["state"] for robot in found["robots"]}


def check_a_live_table(out: Path) -> None:
    """On a terminal, until Ctrl-C."""
    terminal, theirs = pty.openpty()
    seen = bytearray()

    def read() -> None:
        with suppress(OSError):  # the end of a terminal whose last user has gone
            while more := os.read(terminal, 65536):
                seen.extend(more)

    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100", "LINES": "30"}
    command, streams = [UNSPOKEN, "status", out], dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
    with subprocess.Popen(command, env=environment, **streams) as live:
        os.close(theirs)
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


def test_a_run_can_be_looked_at_while_it_goes_on_and_not_after(bench, process, tmp_path):
    run = bench("run", "run", endless(tmp_path / "endless.yaml", 2), "--restart", "never")
    run.reach(5)
    found = look(run.out)
    assert states(found) == {"1": "ready", "2": "ready"}
    assert found["world"]["state"] == "drives"
    assert found["world"]["rate_hz"] > 0.0
    for robot in found["robots"]:
        assert 0.0 < robot["decide_ms"]["p50"] <= robot["decide_ms"]["p99"]
        assert robot["lag_ms"]["p50"] > 0.0
    way = run.out / FILE
    assert stat.S_IMODE(way.stat().st_mode) == 0o600
    assert stat.S_IMODE(Path(json.loads(way.read_text())["password_file"]).stat().st_mode) == 0o600
    check_a_live_table(run.out)
    follows = process("status", "status", run.out, "--json")
    follows.tells('"state":"ready"')

    run.kill("agent", robot="2")
    assert states(look(run.out)) == {"1": "ready", "2": "lost"}
    exit_status, table, _ = status(run.out)  # no terminal: once
    assert exit_status == 0
    assert [line.split()[:2] for line in table.splitlines()[2:]] == [["1", "ready"], ["2", "lost"]]

    run.signal(signal.SIGINT)
    assert follows.end() == 0
    assert json.loads(follows.told.splitlines()[-1])["world"]["verdict"] == "interrupted"
    run.end()
    assert not way.exists()
    exit_status, _, complained = status(run.out)
    assert (exit_status, complained.count("\n")) == (1, 1)
    assert "this run has ended" in complained


def test_a_world_elsewhere_tells_who_is_missing_and_lets_only_the_bench_look(
    process, endpoint, tmp_path, temporary
):
    passwords = new_passwords(["@bench", "1", "2"])
    write_users(temporary / "users", passwords)
    for name, password in passwords.items():
        write_password(temporary / name, password)
    scenario = write_scenario(tmp_path / "two.yaml", lanes(2, 4.0))
    told = ("--scenario", scenario, "--listen", endpoint, "--users", temporary / "users", "--run", "here")
    world = process("world", "world", *told, "--start-timeout", 600)
    world.tells("waiting for robots")
    here = ("--connect", endpoint, "--run", "here")
    agent = ("agent", "--robot", "1", "--goal", "4,0,0", *here, "--password-file", temporary / "1")
    process("agent", *agent)
    world.tells("missing=2 ")
    bench = ("--password-file", temporary / "@bench")
    found = look(*here, *bench)
    assert found["world"]["state"] == "waits"
    assert states(found) == {"1": "present", "2": "missing"}
    for arguments, complaint in (
        ((*here, "--password-file", temporary / "1"), "refuses us"),
        (here, ""),
        (("--connect", endpoint, "--run", "there", *bench), "does not answer for a run 'there'"),
    ):
        exit_status, said, complained = status(*arguments, "--once", "--json")
        assert (exit_status, said) == (3, "")
        assert complaint in complained
