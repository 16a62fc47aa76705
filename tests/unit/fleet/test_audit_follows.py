"""Whatever honest runs record can be repeated, bit for bit."""

import random
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
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.audit.command import conclusion
from fleet.audit.recorded import open_run
from fleet.audit.replay import Audit, Tally
from fleet.interruption import Interruption
from fleet.record.experiment import Experiment
from fleet.record.recording import BusMessage
from fleet.run.virtual import simulate
from protocol.messages import Command, Mind, Truth

MEAN_PAUSE_S = 0.001


@pytest.mark.parametrize(
    ("goals", "rules"),
    [
        ("exchanged", {}),
        ("kalman-filter", {}),
        ("joint-fit", {"sensing": DIM}),
        ("ioc", {"sensing": DIM}),
        ("constant-velocity", {"robots": [MEETING[0], {**MEETING[1], "sensing": DIM}]}),
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


@settings(max_examples=12)
@given(st.lists(st.fixed_dictionaries(dict.fromkeys("12", st.sampled_from(WHIMS))), max_size=8))
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


@pytest.mark.parametrize("step", [0, 4])
def test_an_interrupted_run_follows(tmp_path: Path, step: int) -> None:
    experiment, interruption = experiment_of(tmp_path), Interruption()

    def until_then() -> Iterator[BusMessage]:
        for message in simulate(experiment, interruption):
            yield message
            interruption.requested |= getattr(message.message, "step", -1) >= step

    report = audited(write(tmp_path / "run.mcap", experiment, until_then()))
    assert report.differences == ()
    assert (report.verdict, report.last_step) == ("interrupted", step)
    assert [robot.observations.recorded for robot in report.robots] == [step + 1, step + 1]


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> tuple[Experiment, list[BusMessage]]:
    experiment = experiment_of(tmp_path_factory.mktemp("honest"), "constant-acceleration")
    return experiment, simulated(experiment)


def test_a_run_that_was_interrupted_before_its_start_follows(tmp_path: Path, honest: Any) -> None:
    experiment, (scene, *messages) = honest
    truth = next(message for message in messages if isinstance(message.message, Truth))
    ended = truth._replace(message=truth.message.model_copy(update={"verdict": "interrupted"}))
    assert audited(write(tmp_path / "run.mcap", experiment, [scene, ended])).result == "follows"


@pytest.mark.parametrize("cut", range(1, 8))
def test_a_recording_that_ends_anywhere_follows_as_far_as_it_goes_and_that_is_told(
    tmp_path: Path, honest: Any, cut: int
) -> None:
    experiment, all_messages = honest
    messages = [message for message in all_messages if getattr(message.message, "step", 0) < 4]
    report = audited(write(tmp_path / "run.mcap", experiment, messages[:-cut]))
    assert report.differences == ()
    assert report.verdict is None
    told = f"ends without a verdict: what came after step {report.last_step} is not shown"
    assert told in conclusion(report)


def test_an_audit_that_is_interrupted_tells_what_it_has_found_so_far(tmp_path: Path, honest: Any) -> None:
    audit = Audit(open_run(write(tmp_path / "run.mcap", *honest)))

    def interrupt(robot: str, done: int, _total: int) -> None:
        if (robot, done) == ("2", 5):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        audit.go(interrupt)
    report = audit.report()
    assert report.result == "interrupted"
    assert [robot.id for robot in report.robots] == ["1"]
    assert conclusion(report).startswith("Interrupted")
