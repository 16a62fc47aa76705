import os
import shlex
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


def said_under(journal):
    """What a process says on stdout and stderr whose stderr goes to the journal, or not."""
    reads, writes = os.pipe()
    stream = os.fstat(writes)
    told = f"{stream.st_dev}:{stream.st_ino if journal else 1}"
    process = subprocess.run(
        [sys.executable, "-c", SAYS],
        env={**os.environ, "JOURNAL_STREAM": told, "NO_COLOR": "1"},
        stdout=subprocess.PIPE,
        stderr=writes,
        text=True,
        check=True,
    )
    os.close(writes)
    with os.fdopen(reads) as stderr:
        return process.stdout, stderr.read()


def test_lines_for_the_journal_have_their_priority_and_stay_one_line_each():
    stdout, stderr = said_under(journal=True)
    assert stdout == ""
    joined, refused, broken = stderr.splitlines()
    assert joined == "<6>event=joined robot=3 robots=8 late=false level=info"
    assert refused.startswith("<4>event=refused ")
    fields = dict(each.split("=", 1) for each in shlex.split(refused[3:]))
    assert fields == {
        "event": "refused",
        "level": "warning",
        "reason": 'an "odd"\\nreason = 4',
        "robot": "3",
    }
    assert broken.startswith("<3>event=broken")
    assert "ZeroDivisionError" in broken


def test_elsewhere_lines_are_for_people():
    stdout, stderr = said_under(journal=False)
    assert stderr == ""
    assert "[info     ] joined" in stdout
    assert not any(line.startswith("<") for line in stdout.splitlines())


@pytest.mark.parametrize("variable", [{}, {"JOURNAL_STREAM": "nonsense"}])
def test_without_a_journal_nothing_changes(variable):
    environment = {name: value for name, value in os.environ.items() if name != "JOURNAL_STREAM"}
    said = subprocess.run(
        [sys.executable, "-c", SAYS], env={**environment, **variable}, capture_output=True, text=True
    )
    assert (said.returncode, said.stderr) == (0, "")
    assert "joined" in said.stdout
