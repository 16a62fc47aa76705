"""How a process of ours begins and ends: its log lines, signals, and health checks of it."""

import os
import shlex
import signal
import subprocess
import sys

import pytest

SAYS = """
import structlog
from chassis.process import log_to_journal
log_to_journal()
log = structlog.get_logger("agent").bind(robot="3")
log.info("joined", robots=8, late=False)
log.warning("refused", reason='an "odd"\\nreason = 4')
try:
    1 / 0
except ZeroDivisionError:
    log.exception("broken")
"""
WAITS = """
import queue
from chassis.process import on_wish_to_end
inbox = queue.SimpleQueue()
on_wish_to_end(lambda: inbox.put("end"))
print("waiting", flush=True)
print(inbox.get(), flush=True)
"""


def said(journal):
    """What a process says on stdout and stderr, where its stderr is this journal's, another's or none's."""
    reads, writes = os.pipe()
    stream = os.fstat(writes)
    streams = {"ours": f"{stream.st_dev}:{stream.st_ino}", "another's": f"{stream.st_dev}:1"}
    environment = {name: value for name, value in os.environ.items() if name != "JOURNAL_STREAM"}
    if journal is not None:
        environment["JOURNAL_STREAM"] = streams.get(journal, journal)
    environment["NO_COLOR"] = "1"
    program = [sys.executable, "-c", SAYS]
    ran = subprocess.run(
        program, env=environment, stdout=subprocess.PIPE, stderr=writes, text=True, check=True
    )
    os.close(writes)
    with os.fdopen(reads) as stderr:
        return ran.stdout, stderr.read()


def test_lines_for_the_journal_have_their_priority_and_stay_one_line_each():
    stdout, stderr = said("ours")
    assert stdout == ""
    joined, refused, broken = stderr.splitlines()
    assert joined == "<6>event=joined robot=3 robots=8 late=false level=info"
    assert refused.startswith("<4>event=refused ")
    fields = dict(each.split("=", 1) for each in shlex.split(refused[3:]))
    assert fields == {"event": "refused", "level": "warning", "reason": 'an "odd"\\nreason = 4', "robot": "3"}
    assert broken.startswith("<3>event=broken")
    assert "ZeroDivisionError" in broken


@pytest.mark.parametrize("journal", [None, "nonsense", "another's"])
def test_elsewhere_lines_are_for_people(journal):
    stdout, stderr = said(journal)
    assert stderr == ""
    assert "joined" in stdout
    assert not any(line.startswith("<") for line in stdout.splitlines())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_wait_of_the_main_thread(number):
    with subprocess.Popen([sys.executable, "-c", WAITS], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "waiting\n"
            process.send_signal(number)
            assert process.communicate(timeout=60)[0] == "end\n"
        finally:
            process.kill()
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "port", "status", "line"),
    [
        ([], "", 1, "the port at which the process can be watched is expected"),
        ([], "70000", 1, "the port at which the process can be watched is expected"),
        (["live"], "1", 1, "nobody answers at http://127.0.0.1:1/live"),
        (["reday"], "1", 2, "reday"),
    ],
)
def test_a_health_check_says_in_a_line_what_it_needs_or_that_nobody_answers(arguments, port, status, line):
    program = [sys.executable, "-m", "chassis.healthy", *arguments]
    environment = {**os.environ, "UNSPOKEN_WATCH_PORT": port}
    asked = subprocess.run(program, env=environment, capture_output=True, text=True)
    complained = asked.stdout + asked.stderr
    assert asked.returncode == status
    assert line in complained
    assert status == 2 or complained.count("\n") == 1
