"""The set-up is done when it is needed, and refuses clearly; continuous integration runs all checks."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CI_RUN = ROOT / ".ci" / "run"
ENVIRONMENT = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
"""Without the variables of a make that runs the tests."""


@pytest.fixture
def clone(tmp_path):
    """What make looks at, in a folder with a space in its name."""
    folder = tmp_path / "a clone"
    (folder / "tests" / "processes" / "deploy").mkdir(parents=True)
    for name in ("Makefile", "pyproject.toml", "constraints.txt", "tests/processes/deploy/compose-tool.txt"):
        shutil.copy(ROOT / name, folder / name)
    return folder


def make(folder, *arguments):
    return subprocess.run(
        ["make", *arguments], cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False
    )


def set_up_at(folder, time_s):
    """Leave the stamps of a set-up made at a time."""
    (folder / ".venv").mkdir()
    for name in ("ready", "ready-for-tests"):
        (folder / ".venv" / name).touch()
        os.utime(folder / ".venv" / name, (time_s, time_s))


def stand_in_python(folder, preparation):
    """A Python in which something is not as it should be."""
    script = folder / "python"
    script.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" -c "import sys; {preparation}; exec(sys.argv[2])" "$@"\n'
    )
    script.chmod(0o755)
    return script


TARGETS = ("run", "check", "test", "test-slow")


def test_help_is_the_default_and_lists_every_target():
    said = make(ROOT).stdout
    (phony,) = re.findall(r"^\.PHONY: (.*)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert set(re.findall(r"^make ([a-z-]+)", said, re.MULTILINE)) == set(phony.split())


@pytest.mark.parametrize("target", TARGETS)
def test_every_target_sets_up_first_and_once_and_again_when_what_to_install_changes(clone, target):
    first, *_ = [line for line in make(clone, "--dry-run", target).stdout.splitlines() if " -m venv " in line]
    assert first.endswith(".venv")
    newest_s = max(path.stat().st_mtime for path in clone.rglob("*"))
    set_up_at(clone, newest_s + 1)
    planned = make(clone, "--dry-run", target)
    assert planned.returncode == 0, planned.stderr
    assert "pip" not in planned.stdout
    for changed in ("pyproject.toml", "constraints.txt"):
        os.utime(clone / changed, (newest_s + 2, newest_s + 2))
        assert "pip install" in make(clone, "--dry-run", target).stdout
        os.utime(clone / changed, (newest_s, newest_s))


@pytest.mark.parametrize(
    ("preparation", "told"),
    [
        (None, "There is no command no-such-python. Python 3.11 or newer is needed."),
        ("sys.version_info = (3, 10, 13)", "Python 3.11 or newer is needed."),
        ("sys.modules['ensurepip'] = None", "python3-venv"),
    ],
)
def test_a_python_that_will_not_do_is_refused(clone, preparation, told):
    python = "no-such-python" if preparation is None else stand_in_python(clone, preparation)
    refused = make(clone, "run", f"PYTHON={python}")
    assert refused.returncode != 0
    assert told in refused.stderr
    assert not (clone / ".venv").exists()


@pytest.mark.parametrize(
    ("failing", "calls"),
    [
        ("nothing", ["python3 -c", "make check", "make test", "make test-slow"]),
        ("make check", ["python3 -c", "make check"]),
        ("make test", ["python3 -c", "make check", "make test"]),
        ("make test-slow", ["python3 -c", "make check", "make test", "make test-slow"]),
        (
            "python3 -c",
            ["python3 -c", "apt-get update", "apt-get install", "make check", "make test", "make test-slow"],
        ),
    ],
)
def test_continuous_integration_installs_what_lacks_and_stops_at_the_first_check_that_fails(
    tmp_path, failing, calls
):
    """With stand-ins that note how they are called."""
    noted = tmp_path / "calls"
    (needed,) = re.findall(r"^needed=\((.*)\)$", CI_RUN.read_text(), re.MULTILINE)
    for name in {"python3", "apt-get", *needed.split()}:
        stand_in = tmp_path / name
        stand_in.write_text(f'#!/bin/sh\necho "{name} $1" >> "{noted}"\ntest "{name} $1" != "{failing}"\n')
        stand_in.chmod(0o755)
    environment = ENVIRONMENT | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    status = subprocess.run(["bash", CI_RUN], env=environment, check=False).returncode
    assert (status == 0) is not failing.startswith("make")
    assert noted.read_text().splitlines() == calls
