"""Robots that flood or send garbage lose their own service, not anybody else's, and all of it is counted."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from process_helpers import endless

HOSTILE = Path(__file__).with_name("hostile.py")
FUZZED = 20_000
LONGEST_S = 400.0
ROOM_MIB = 64
"""Memory that hostile messages may take at the most, queues of connections included."""


@contextmanager
def hostile(run, robot, kind, *, what, count=0):
    """A process that speaks as a robot of the run, with the password that the run gave it."""
    key, password_file = getattr(run.keys(), kind)(robot), run.folder / f"{robot}.password"
    arguments = (run.endpoint, robot, password_file, key, count, what)
    process = subprocess.Popen([sys.executable, HOSTILE, *map(str, arguments)])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def memory_mib(run):
    """Of the world and of the bench."""
    pids = (run.pid("world"), run.own_pid)
    return [psutil.Process(pid).memory_info().rss / 2**20 for pid in pids]


@pytest.mark.slow
def test_floods_and_thousands_of_spoilt_payloads_are_counted_and_hold_up_nobody_else(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 3))
    run.reach(5)
    # Robot 1 itself says nothing more: whatever comes under its name is spoilt.
    os.kill(run.pid("agent", "1"), signal.SIGKILL)
    run.logs("world", "robot lost")
    before_mib = memory_mib(run)
    counts = {"command": FUZZED // 2, "mind": FUZZED // 2}
    with run.watched() as truths:
        for kind, count in counts.items():
            with hostile(run, "1", kind, what="fuzz", count=count) as process:
                assert process.wait(LONGEST_S) == 0
        # The world takes no more than some of them a step.
        truths.wait_for(
            lambda truth: sum(truth.refused.get("1", {}).values()) >= counts["command"], LONGEST_S
        )
        with hostile(run, "2", "command", what="flood"), hostile(run, "2", "mind", what="flood"):
            flooded = truths.wait_for(lambda truth: "2" in truth.refused)
            truths.reached(flooded.step + 100)
            for before, after in zip(before_mib, memory_mib(run), strict=True):
                assert after < before + ROOM_MIB
            last = truths.all[-1]
    # A busy machine may once take a connection for lost.
    assert last.robots["3"].deadline_misses <= last.step // 100
    run.signal(signal.SIGINT)
    run.end()
    refused = run.summary["refused"]
    assert refused.keys() == {"1", "2"}
    of_minds = {reason for reason in refused["1"] if reason.startswith("mind: ")}
    assert sum(refused["1"][reason] for reason in of_minds) == counts["mind"]
    assert sum(refused["1"][reason] for reason in refused["1"].keys() - of_minds) == counts["command"]
    for reason in ("not a valid message", "mind: not a valid message"):
        assert refused["2"][reason] > 100
    assert "Refused of robot 1: " in run.told
