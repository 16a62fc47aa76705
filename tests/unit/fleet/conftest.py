"""What tests of several commands need: a clock for keys, and every umask."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from keys_helpers import Clock

from fleet.keys import command


@pytest.fixture
def clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Clock:
    """A clock that stands still, in an empty directory."""
    monkeypatch.chdir(tmp_path)
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")
    clock = Clock()
    monkeypatch.setattr(command, "_now", lambda: clock.now)
    return clock


@pytest.fixture(params=[0o000, 0o022, 0o077], ids=oct)
def umask(request: pytest.FixtureRequest) -> Iterator[None]:
    former = os.umask(request.param)
    yield
    os.umask(former)
