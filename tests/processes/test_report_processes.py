"""An evaluation, its report, and the command that the report tells, given one after another."""

import json
import shlex
from html import unescape
from pathlib import Path

import pytest

from fleet.evaluate.results import read_rows


@pytest.mark.slow
def test_an_evaluated_run_is_reported_and_repeated_by_the_told_command(tmp_path: Path, process):
    out = tmp_path / "out"
    evaluation = ("evaluate", "2-crossing", "--goals", "constant-velocity", "--workers", 1, "--out", out)
    evaluated = process("evaluated", *evaluation)
    assert evaluated.end() == 0, evaluated.complained
    reported = process("reported", "report", out, "--worst", 1)
    assert reported.end() == 0, reported.complained
    page = unescape((out / "report.html").read_text(encoding="utf-8"))
    assert "The picture shows another run" not in page
    _, *command = shlex.split(page.partition("<pre>")[2].partition("</pre>")[0])
    repeated = process("repeated", *command, "--out", tmp_path / "again")
    assert repeated.end() in (0, 1), repeated.complained
    (row,) = read_rows(out)
    summary = json.loads((tmp_path / "again" / "summary.json").read_text())
    told = ("verdict", "duration_s", "minimum_distance_m", "steps", "collisions")
    assert [summary[name] for name in told] == [getattr(row, name) for name in told]
