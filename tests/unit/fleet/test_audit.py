"""Whatever honest runs record can be repeated, bit for bit; ``unspoken audit`` and ``unspoken replay``."""

import json
import os
import random
import signal
import tempfile
from collections.abc import Iterator
from itertools import accumulate, count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from auditing_helpers import (
    DIM,
    MEETING,
    STEPS,
    as_in_real_time,
    audited,
    experiment_of,
    simulated,
    write,
)
from click.testing import Result
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from fleet.audit.command import conclusion
from fleet.audit.replay import Tally
from fleet.cli import app
from fleet.interruption import Interruption
from fleet.record.experiment import Experiment
from fleet.record.recording import BusMessage
from fleet.run.virtual import simulate
from protocol.messages import Command, Mind

MEAN_PAUSE_S = 0.001
STEP = 5


@pytest.mark.parametrize(
    ("goals", "rules"),
    [
        ("exchanged", {}),
        ("constant-velocity", {"reserve": False}),
        ("ioc", {"sensing": DIM}),
        ("kalman-filter", {"robots": [MEETING[0], {**MEETING[1], "sensing": DIM}]}),
    ],
)
def test_everything_follows_in_a_simulated_run(tmp_path: Path, goals: str, rules: Any) -> None:
    experiment = experiment_of(tmp_path, goals, **rules)
    report = audited(write(tmp_path / "run.mcap", experiment, simulated(experiment)))
    assert report.differences == ()
    assert report.result == "follows"
    assert (report.verdict, report.last_step) == ("timeout", STEPS)
    for robot in report.robots:
        assert robot.observations == robot.minds == robot.commands == Tally(STEPS, STEPS)
    assert report.truths == Tally(STEPS + 1, STEPS + 1)
    assert report.goals_told == (goals == "exchanged")
    assert [set(robot.reads) for robot in report.robots] == [
        {f"unspoken/{experiment.facts.run}/pose/{robot.id}", f"unspoken/{experiment.facts.run}/scene"}
        for robot in report.robots
    ]


WHIMS = ("in time", "withdraws", "too late", "asleep", "restarted")


@settings(max_examples=8)
@given(st.lists(st.fixed_dictionaries(dict.fromkeys("12", st.sampled_from(WHIMS))), max_size=STEPS - 1))
def test_everything_follows_however_robots_are_late_asleep_or_restarted(course: list[dict[str, str]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        experiment = experiment_of(Path(folder), "constant-acceleration")
        report = audited(write(Path(folder) / "run.mcap", experiment, as_in_real_time(experiment, course)))
    assert report.differences == ()
    for robot in report.robots:
        whims = [what[robot.id] for what in course]
        assert robot.minds.recorded == len(whims) - whims.count("asleep")
        assert robot.commands.recorded == robot.minds.recorded - whims.count("withdraws")
    assert (report.verdict, report.last_step) == ("interrupted", len(course))


def test_decisions_that_the_clock_cut_short_are_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """This clock goes on by chance with every look at it."""
    pauses = random.Random(0)
    readings = accumulate(pauses.expovariate(1.0 / MEAN_PAUSE_S) for _ in count())
    monkeypatch.setattr("fleet.run.virtual.time", SimpleNamespace(perf_counter=lambda: next(readings)))
    experiment = experiment_of(tmp_path, budget_ms=4e3 * MEAN_PAUSE_S)
    messages = simulated(experiment)
    cut = {message.message.cut_short_at for message in messages if isinstance(message.message, Mind)}
    assert len(cut - {None}) > 1, "cut at several questions"
    unlimited = simulated(experiment_of(tmp_path))
    assert [m.message for m in messages if isinstance(m.message, Command)] != [
        m.message for m in unlimited if isinstance(m.message, Command)
    ], "time was short enough to change something"
    assert audited(write(tmp_path / "run.mcap", experiment, messages)).differences == ()


def test_an_interrupted_run_follows(tmp_path: Path) -> None:
    experiment, interruption = experiment_of(tmp_path, "constant-acceleration"), Interruption()

    def until_then() -> Iterator[BusMessage]:
        for message in simulate(experiment, interruption):
            yield message
            interruption.requested |= getattr(message.message, "step", -1) >= 4

    report = audited(write(tmp_path / "run.mcap", experiment, until_then()))
    assert report.differences == ()
    assert (report.verdict, report.last_step) == ("interrupted", 4)
    assert [robot.observations.recorded for robot in report.robots] == [5, 5]


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> tuple[Experiment, list[BusMessage]]:
    experiment = experiment_of(tmp_path_factory.mktemp("honest"), "constant-acceleration")
    return experiment, simulated(experiment)


def test_a_recording_that_ends_anywhere_follows_as_far_as_it_goes_and_that_is_told(
    tmp_path: Path, honest: Any
) -> None:
    experiment, all_messages = honest
    messages = [message for message in all_messages if getattr(message.message, "step", 0) < 3]
    for cut in range(1, 8):
        report = audited(write(tmp_path / f"{cut}.mcap", experiment, messages[:-cut]))
        assert report.differences == ()
        assert report.verdict is None
        told = f"ends without a verdict: what came after step {report.last_step} is not shown"
        assert told in conclusion(report)


@pytest.fixture(autouse=True)
def _wide_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, honest: Any) -> Path:
    """The directory of an honest run."""
    return write(tmp_path_factory.mktemp("run") / "run.mcap", *honest).parent


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


def test_audit_and_replay_name_the_first_difference(tmp_path: Path, honest: Any) -> None:
    def changed(message: Any) -> Any:
        """Another turn rate in a command of robot 2."""
        said = message.message
        if isinstance(said, Command) and (said.robot, said.step) == ("2", STEP):
            return message._replace(message=said.model_copy(update={"turn_rate_radps": 0.125}))
        return message

    experiment, messages = honest
    write(tmp_path / "run.mcap", experiment, map(changed, messages))
    where = f"robot 2, step {STEP}, command turn_rate_radps: recorded 0.125, repeated "
    result = unspoken("audit", tmp_path)
    assert result.exit_code == 1, result.output
    assert f"no, {STEPS - 1} of {STEPS}" in result.stdout
    assert where in result.stdout
    result = unspoken("replay", tmp_path, "--robot", "2", "--steps")
    assert result.exit_code == 1, result.output
    assert where in result.stdout
    lines = {line.split()[0]: line for line in result.stdout.splitlines() if line.split()[0].isdigit()}
    assert len(lines) == STEPS
    assert [step for step, line in lines.items() if "no: command" in line] == [str(STEP)]
    result = unspoken("replay", tmp_path, "--robot", "1")
    assert result.exit_code == 0, "the other robot saw what it had seen"
    assert f"All {STEPS} decisions of robot 1 follow" in result.stdout


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


def test_what_is_no_recording_and_an_unknown_robot_or_step_are_refused(run: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("no recording at all")
    for arguments, told in (
        (("audit", tmp_path), "run.mcap: cannot be read: No such file or directory"),
        (("audit", tmp_path / "text.mcap"), "not an MCAP file"),
        (("replay", run, "--robot", "9"), "this run has no robot '9'; its robots are 1, 2"),
        (("replay", run, "--robot", "1", "--debug-at", 17), f"it made them from step 0 to {STEPS - 1}"),
    ):
        result = unspoken(*arguments)
        assert result.exit_code == 2
        assert told in result.stderr
