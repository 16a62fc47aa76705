"""``unspoken keys`` as the tests of its commands call it."""

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

from click.testing import Result
from typer.testing import CliRunner

from fleet.cli import app

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)


class Clock:
    """The time as the commands see it."""

    now = NOW

    def pass_days(self, days: float) -> None:
        self.now += timedelta(days=days)


def keys(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["keys", *map(str, arguments)])


def made(*options: object) -> Path:
    """Keys of robots 1 and 2."""
    assert keys("create", "mine", "--robot", 1, "--robot", 2, *options).exit_code == 0
    return Path("mine")


def content(directory: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(directory.rglob("*")) if path.is_file()}


def rows(result: Result) -> dict[str, list[str]]:
    """The rows of the table by folder: who, when and state."""
    cells = [re.split(r"  +", line.strip()) for line in result.stdout.splitlines()]
    return {row[1]: [row[0], *row[2:]] for row in cells[2:] if len(row) == 4}
