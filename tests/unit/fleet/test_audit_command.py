"""``unspoken audit`` and ``unspoken replay``, in this process."""

import json
import os
import signal
import sys
from bdb import BdbQuit
from pathlib import Path
from typing import Any

import pytest
from auditing_helpers import STEPS, as_in_real_time, experiment_of, simulated, write
from click.testing import Result
from typer.testing import CliRunner

from fleet.cli import app
from protocol.messages import Command

STEP = 5


@pytest.fixture(autouse=True)
def _wide_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of an honest run."""
    folder = tmp_path_factory.mktemp("run")
    experiment = experiment_of(folder)
    write(folder / "run.mcap", experiment, simulated(experiment))
    return folder


@pytest.fixture(scope="module")
def tampered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with another turn rate in a command of robot 2."""
    folder = tmp_path_factory.mktemp("tampered")
    experiment = experiment_of(folder)

    def changed(message: Any) -> Any:
        if isinstance(message.message, Command) and message.message.step == STEP:
            return message._replace(message=message.message.model_copy(update={"turn_rate_radps": 0.125}))
        return message

    messages = [changed(each) if each.key.endswith("/2") else each for each in simulated(experiment)]
    write(folder / "run.mcap", experiment, messages)
    return folder


def unspoken(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_an_audit_shows_a_row_a_robot_and_what_follows_and_writes_its_report(
    run: Path, tmp_path: Path
) -> None:
    file = tmp_path / "audit.json"
    result = unspoken("audit", run, "--json", file)
    assert result.exit_code == 0, result.output
    rows = [line.split() for line in result.stdout.splitlines() if line.split()[:1] in (["1"], ["2"])]
    assert rows == [[robot, str(STEPS), "yes", str(STEPS), "yes", "yes"] for robot in "12"]
    assert f"all {2 * STEPS} decisions" in result.stdout
    assert "The scene holds no goals" in result.stdout
    printed = unspoken("audit", run / "run.mcap", "--json", "-")
    report = json.loads(printed.stdout)
    assert report == json.loads(file.read_text(encoding="utf-8"))
    assert "Everything follows" in printed.stderr
    assert (report["schema"], report["result"], report["differences"]) == (1, "follows", [])
    assert [robot["commands"] for robot in report["robots"]] == 2 * [{"recorded": STEPS, "identical": STEPS}]


def test_audit_and_replay_name_the_first_difference(tampered: Path) -> None:
    where = f"robot 2, step {STEP}, command turn_rate_radps: recorded 0.125, repeated "
    result = unspoken("audit", tampered)
    assert result.exit_code == 1, result.output
    assert f"no, {STEPS - 1} of {STEPS}" in result.stdout
    assert where in result.stdout
    result = unspoken("replay", tampered, "--robot", "2", "--steps")
    assert result.exit_code == 1, result.output
    assert where in result.stdout
    lines = {line.split()[0]: line for line in result.stdout.splitlines() if line.split()[0].isdigit()}
    assert len(lines) == STEPS
    assert [step for step, line in lines.items() if "no: command" in line] == [str(STEP)]
    result = unspoken("replay", tampered, "--robot", "1")
    assert result.exit_code == 0, "the other robot saw what it had seen"
    assert f"All {STEPS} decisions of robot 1 follow" in result.stdout


def test_where_the_report_cannot_be_written_nothing_is_repeated(run: Path, tmp_path: Path) -> None:
    result = unspoken("audit", run, "--json", tmp_path / "missing" / "audit.json")
    assert result.exit_code == 2
    assert "audit.json: the report cannot be written there" in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize("command", [("audit",), ("replay", "--robot", "1")])
def test_what_is_no_recording_is_refused_in_a_line(tmp_path: Path, command: tuple[str, ...]) -> None:
    (tmp_path / "text.mcap").write_text("no recording at all")
    for path, told in (
        (tmp_path, "run.mcap: cannot be read: No such file or directory"),
        (tmp_path / "text.mcap", "not an MCAP file"),
    ):
        result = unspoken(*command, path)
        assert result.exit_code == 2
        assert result.stderr.count("\n") == 1
        assert told in result.stderr


def test_a_scenario_in_a_recording_that_is_none_is_refused(tmp_path: Path) -> None:
    experiment = experiment_of(tmp_path)
    experiment.path.write_text("name: 3", encoding="utf-8")
    write(tmp_path / "run.mcap", experiment, [])
    result = unspoken("audit", tmp_path)
    assert result.exit_code == 2
    assert "the scenario attached to the recording cannot be used" in result.stderr


@pytest.mark.parametrize("command", [("audit",), ("replay", "--robot", "1")])
def test_ctrl_c_ends_it_in_order(
    run: Path, command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupting(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("fleet.audit.command.compile_solver", interrupting)
    result = unspoken(*command, run)
    assert result.exit_code == 1, result.output
    assert "Interrupted" in result.stdout


def test_each_step_of_a_replay_is_a_line_also_one_whose_command_was_withdrawn(tmp_path: Path) -> None:
    experiment = experiment_of(tmp_path, "constant-acceleration")
    course = [{"1": what, "2": "in time"} for what in ("in time", "withdraws", "asleep", "in time")]
    write(tmp_path / "run.mcap", experiment, as_in_real_time(experiment, course))
    result = unspoken("replay", tmp_path, "--robot", "1", "--steps")
    assert result.exit_code == 0, result.output
    steps = [line for line in result.stdout.splitlines() if line.split()[0].isdigit()]
    assert [line.split()[0] for line in steps] == ["0", "1", "3"]
    assert ["late: withdrawn" in line for line in steps] == [False, True, False]


def test_an_unknown_robot_or_step_is_refused_with_those_there_are(run: Path) -> None:
    result = unspoken("replay", run, "--robot", "9")
    assert result.exit_code == 2
    assert "this run has no robot '9'; its robots are 1, 2" in result.stderr
    result = unspoken("replay", run, "--robot", "1", "--debug-at", STEPS + 5)
    assert result.exit_code == 2
    made = f"it made them from step 0 to {STEPS - 1}"
    assert f"no decision at step {STEPS + 5} of this run; {made}" in result.stderr


def test_the_debugger_is_entered_before_one_decision_and_whoever_quits_it_ends_the_replay(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    entered = []

    def enter() -> None:
        around = sys._getframe(1).f_locals
        entered.append((around["observation"].step, type(around["agent"]).__name__))
        if len(entered) == 2:
            raise BdbQuit

    monkeypatch.setattr(sys, "breakpointhook", enter)
    assert unspoken("replay", run, "--robot", "1", "--debug-at", STEP).exit_code == 0
    assert entered == [(STEP, "Agent")]
    result = unspoken("replay", run, "--robot", "1", "--debug-at", STEP)
    assert result.exit_code == 1
    assert f"Interrupted: {STEP} of {STEPS} decisions" in result.stdout
