"""``unspoken bench`` as a person and as a script see it."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import Result
from pydantic import ValidationError
from typer.testing import CliRunner

from chassis.refusal import ExitStatus, Refusal
from fleet.bench import processes
from fleet.bench.command import SECTIONS, Figures, Report, judge
from fleet.bench.measuring import Progress, SectionName, Settings
from fleet.bench.processes import StartupRow
from fleet.cli import app
from world.bus import Inbox

LITTLE = ("--robots", 2, "--crossings", 2, "--steps", 4, "--decisions", 4, "--rounds", 5, "--starts", 1)
ROW = StartupRow(together=1, starts=1, ready_s=2.0, cpu_s=1.0, resident_mib=100.0)


def unspoken_bench(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["bench", *map(str, arguments)])


def test_the_report_has_a_place_for_every_section_and_a_section_for_every_name():
    assert tuple(SECTIONS) == tuple(SectionName) == tuple(Figures.model_fields)


def test_the_json_is_a_valid_report_and_the_tables_show_its_numbers():
    result = unspoken_bench("--only", "decision", "--only", "prediction", *LITTLE, "--json", "-")
    assert result.exit_code == 0, result.output
    report = Report.model_validate_json(result.stdout)
    assert report.complete
    assert report.settings.sections == ("prediction", "decision")
    crossings, ring = report.figures.prediction
    assert (crossings.scenario, crossings.loops) == ("random", 2)
    assert (crossings.first.count, crossings.later.count) == (2, 6)
    assert (ring.scenario, ring.loops, ring.first.count, ring.later.count) == ("circle", 1, 1, 3)
    (decided,) = report.figures.decision
    assert (decided.scenario, decided.first.count, decided.later.count) == ("2-crossing", 2, 4)
    assert all(0.0 < phase.max_ms <= decided.later.cpu.max_ms for phase in decided.phases_cpu.values())
    assert set(decided.phases_cpu) == {"estimate", "predict", "plan"}
    for row, name in ((crossings, "random"), (ring, "circle"), (decided, "2-crossing")):
        [shown] = [line.split() for line in result.stderr.splitlines() if line.split()[:2] == [name, "2"]]
        cpu = row.later.cpu
        assert [float(cell) for cell in shown[3:6]] == pytest.approx(
            [cpu.median_ms, cpu.p99_ms, cpu.max_ms], rel=0.006
        )


def test_the_reference_solver_confirms_the_objectives_and_the_closed_loop():
    result = unspoken_bench("--only", "comparison", *LITTLE, "--steps", 6, "--json", "-")
    (row,) = Report.model_validate_json(result.stdout).figures.comparison
    assert row.same_minimum
    assert abs(row.objective_difference_percent) < 0.1
    assert abs(row.cost_difference_percent) < 0.1
    ours, theirs = row.realtime, row.reference
    assert ours.later.count == theirs.later.count == 5
    assert row.times_faster_median == pytest.approx(theirs.later.cpu.median_ms / ours.later.cpu.median_ms)
    assert row.times_faster_p99 == pytest.approx(theirs.later.cpu.p99_ms / ours.later.cpu.p99_ms)


def test_without_reference_nothing_is_compared():
    result = unspoken_bench("--only", "comparison", "--no-reference", *LITTLE, "--json", "-")
    assert Report.model_validate_json(result.stdout).figures.comparison == ()


def test_a_round_over_the_bus_ends_with_the_last_command_and_says_whose_is_lost(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(processes, "LOST_S", 0.0)
    inbox = Inbox(["1", "2", "3"])
    for robot in ("1", "3"):
        inbox.store_command(robot, b"")
    with pytest.raises(Refusal, match="no answer of robot 2 within"):
        processes.gather({"1", "2", "3"}, inbox)
    inbox.store_command("2", b"")
    processes.gather({"2"}, inbox)


@pytest.mark.parametrize(("ends", "status"), [("Ctrl-C", 1), ("robot-1 was killed by signal 9", 3)])
def test_what_was_measured_before_an_interruption_or_a_failure_is_kept_and_called_incomplete(
    ends: str, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def measure(_settings: Settings, progress: Progress) -> Iterator[StartupRow]:
        yield ROW
        if status == 3:
            raise Refusal(ends, ExitStatus.FAILED)
        signal.raise_signal(signal.SIGTERM)
        progress.begin("the next row")
        raise AssertionError("it went on")

    monkeypatch.setattr(StartupRow, "measure", measure)
    path = tmp_path / "report.json"
    result = unspoken_bench("--only", "startup", "--only", "compiling", "--json", path)
    assert result.exit_code == status
    report = Report.model_validate_json(path.read_text())
    assert (report.complete, report.figures.startup) == (False, (ROW,))
    assert "INCOMPLETE" in result.stdout
    assert (ends in result.stderr) == (status == 3)


def test_a_report_that_cannot_be_written_is_refused_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(StartupRow, "measure", None)
    result = unspoken_bench("--only", "startup", "--json", tmp_path / "missing" / "report.json")
    assert result.exit_code == 2
    assert "report.json: the report cannot be written there: No such file or directory" in result.stderr


@pytest.mark.parametrize("robots", ["", "1", "33", "2,,8", "two", "8;16"])
def test_numbers_of_robots_that_cannot_be_are_refused(robots: str):
    result = unspoken_bench("--robots", robots)
    assert result.exit_code == 2
    assert "from 2 to 32" in result.stderr


def test_targets_are_judged_by_the_worst_figure_and_not_at_all_without_one():
    rows = ROW, ROW.model_copy(update={"ready_s": 3.5}), ROW.model_copy(update={"together": 8})
    targets = {target.what: target for target in judge(Figures(startup=rows))}
    ready = targets.pop("an agent's process, ready after its start")
    assert (ready.measured, ready.limit, ready.met) == (3.5, 3.0, False)
    assert {target.met for target in targets.values()} == {None}
    assert True in {target.met for target in judge(Figures(startup=(ROW,)))}


def test_a_report_holds_no_infinite_number():
    with pytest.raises(ValidationError):
        StartupRow.model_validate({**ROW.model_dump(), "ready_s": float("inf")})
