"""Robots that flood or send garbage lose their own service, not anybody else's, and all of it is counted."""

import json
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from process_helpers import endless, until

from protocol.codec import decode
from protocol.messages import Truth

HOSTILE = Path(__file__).with_name("hostile.py")
FUZZED = 100_000
ROOM_MIB = 64
"""Memory that hostile messages may take at the most, queues of connections included."""


@contextmanager
def hostile(run, robot, kind, *, what, count=0):
    """A process that speaks as a robot of the run, with the password that the run gave it."""
    [endpoint] = re.findall(r"listen=(\S+)", run.log("world"))
    password_file = Path(endpoint.removeprefix("unixsock-stream/")).with_name(f"{robot}.password")
    key = getattr(run.keys(), kind)(robot)
    process = subprocess.Popen(
        [sys.executable, str(HOSTILE), endpoint, robot, str(password_file), key, str(count), what]
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def resident_mib(pid):
    return psutil.Process(pid).memory_info().rss / 2**20


class Watched:
    """The truths of a run as they come."""

    def __init__(self, run):
        self._session = run.listening()
        self.last = None
        self._subscriber = self._session.declare_subscriber(run.keys().truth, self._keep)

    def _keep(self, sample):
        self.last = decode(Truth, sample.payload.to_bytes())

    def passes(self, steps):
        until(lambda: self.last is not None, "a truth")
        goal = self.last.step + steps
        until(lambda: self.last.step >= goal, f"step {goal}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._session.close()


@pytest.mark.slow
def test_two_flooding_robots_hold_up_neither_the_third_nor_the_world(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 3))
    run.reach(5)
    world = run.pid("world")
    before_mib = resident_mib(world), resident_mib(run.own_pid)
    with (
        Watched(run) as truths,
        hostile(run, "1", "command", what="flood"),
        hostile(run, "2", "command", what="flood"),
        hostile(run, "1", "mind", what="flood"),
    ):
        until(lambda: truths.last is not None and truths.last.refused.keys() >= {"1", "2"}, "the flood")
        truths.passes(100)
        after_mib = resident_mib(world), resident_mib(run.own_pid)
        last = truths.last
    assert last.robots["3"].deadline_misses == 0
    assert "3" not in last.refused
    assert sum(last.refused["1"].values()) > 100
    for before, after in zip(before_mib, after_mib, strict=True):
        assert after < before + ROOM_MIB
    run.signal(signal.SIGINT)
    assert run.end() == 1
    summary = json.loads((run.out / "summary.json").read_text())
    assert summary["refused"].keys() == {"1", "2"}
    assert summary["refused"]["1"]["not a valid message"] > 100
    assert summary["refused"]["1"]["mind: not a valid message"] > 100
    assert "Refused of robot 1: " in run.told


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_hundred_thousand_spoilt_payloads_are_all_counted_and_the_run_goes_on(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 3))
    run.reach(5)
    # Robot 1 itself says nothing more: whatever comes under its name is spoilt.
    os.kill(run.pid("agent", "1"), signal.SIGKILL)
    run.logs("world", "robot lost")
    world = run.pid("world")
    before_mib = resident_mib(world), resident_mib(run.own_pid)
    counts = {"command": FUZZED // 2, "mind": FUZZED // 2}
    with Watched(run) as truths:
        for kind, count in counts.items():
            with hostile(run, "1", kind, what="fuzz", count=count) as process:
                assert process.wait(400) == 0
        # The world takes no more than some of them a step.
        until(lambda: sum(truths.last.refused["1"].values()) >= counts["command"], "the last of them", 400.0)
        truths.passes(50)
        after_mib = resident_mib(world), resident_mib(run.own_pid)
        last = truths.last
    assert last.robots["2"].deadline_misses == last.robots["3"].deadline_misses == 0
    for before, after in zip(before_mib, after_mib, strict=True):
        assert after < before + ROOM_MIB
    run.signal(signal.SIGINT)
    run.end()
    refused = json.loads((run.out / "summary.json").read_text())["refused"]
    assert refused.keys() == {"1"}
    of_minds = {reason for reason in refused["1"] if reason.startswith("mind: ")}
    assert sum(refused["1"][reason] for reason in of_minds) == counts["mind"]
    assert sum(refused["1"][reason] for reason in refused["1"].keys() - of_minds) == counts["command"]
