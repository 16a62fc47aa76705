"""The sections of ``unspoken bench`` that start processes."""

import pytest
from typer.testing import CliRunner

from fleet.bench.command import Figures, Report
from fleet.bench.processes import Protection
from fleet.cli import app


def measured(*sections: str) -> Figures:
    only = [each for section in sections for each in ("--only", section)]
    little = ["--robots", "2", "--rounds", "5", "--starts", "1"]
    result = CliRunner().invoke(app, ["bench", *only, *little, "--json", "-"])
    assert result.exit_code == 0, result.output
    return Report.model_validate_json(result.stdout).figures


@pytest.mark.slow
def test_real_processes_are_measured():
    figures = measured("bus", "runs", "startup")
    assert [row.protection for row in figures.bus] == list(Protection)
    for exchange in figures.bus:
        assert (exchange.robots, exchange.rounds) == (2, 5)
        assert 0.0 < exchange.wall.median_ms <= exchange.wall.p99_ms <= exchange.wall.max_ms
    lockstep, realtime = figures.runs
    assert (lockstep.clock, lockstep.verdict, lockstep.deadline_misses) == ("lockstep", "arrived", 0)
    assert realtime.clock == "realtime"
    missed_percent = 100.0 * realtime.deadline_misses / (2 * realtime.steps)
    assert realtime.deadline_misses_percent == pytest.approx(missed_percent)
    alone, together = figures.startup
    assert (alone.together, together.together) == (1, 2)
    for row in (alone, together):
        assert row.ready_s > 0.0
        assert row.cpu_s > 0.0
        assert row.resident_mib > 20.0  # a Python with numpy
    assert lockstep.agent_resident_mib > 20.0


@pytest.mark.slow
def test_compiling_from_nothing_takes_longer_than_loading():
    empty, full = measured("compiling").compiling
    assert (empty.cache, full.cache) == ("empty", "full")
    assert empty.cpu_s > 2.0 * full.cpu_s > 0.0
