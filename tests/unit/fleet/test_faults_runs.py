"""Runs in virtual time with faults: each kind has the effect that it says, and none that it does not."""

import math
from functools import partial
from typing import Any

import pytest
from faults_helpers import STEP_S, facts, fault, run, scenario, truths
from faults_helpers import drive as drive_with

from fleet.run.virtual import Step, closed_loop
from protocol.vehicle import Input, Limits, braking_input

drive = partial(drive_with, goals="exchanged")
"""With the method that computes least; the last test, and those of minds, are about others."""

NEVER = fault("loss", rate=1.0, start_s=1e4)
"""Makes a run one with faults, and does not strike."""
SOON_S = 0.5
SOON = 5
"""That in steps."""


@pytest.fixture(scope="module")
def healthy() -> list[Step]:
    return drive()


def same_until(driven: list[Step], other: list[Step]) -> int:
    """The first step at which two runs stand differently."""
    one, two = (
        [{name: robot.state for name, robot in truth.robots.items()} for truth in truths(each)]
        for each in (driven, other)
    )
    differ = (step for step, (a, b) in enumerate(zip(one, two, strict=False)) if a != b)
    return next(differ, min(len(one), len(two)))


def speeds(driven: list[Step], robot: str) -> list[float]:
    return [truth.robots[robot].state.speed_mps for truth in truths(driven)]


def brakes(driven: list[Step], robot: str) -> None:
    """Check that of a robot which is late from then on, all follows from how it was at that step."""
    last, *late = (truth.robots[robot] for truth in truths(driven)[SOON:])
    previous = Input(last.turn_rate_radps, last.acceleration_mps2)
    assert previous.acceleration_mps2 > 0.1, "it was speeding up"
    assert late[0].acceleration_mps2 < previous.acceleration_mps2, "at once"
    x_m, y_m, heading_rad, speed_mps = last.state.as_tuple()
    limits = Limits()
    for true in late:
        previous = braking_input(limits, previous, speed_mps, STEP_S)
        x_m += STEP_S * speed_mps * math.cos(heading_rad)
        y_m += STEP_S * speed_mps * math.sin(heading_rad)
        heading_rad += STEP_S * previous.turn_rate_radps
        speed_mps += STEP_S * previous.acceleration_mps2
        assert true.state.as_tuple() == pytest.approx((x_m, y_m, heading_rad, speed_mps), abs=1e-9)


@pytest.mark.parametrize(
    "never",
    [[NEVER], [fault(kind, robots=[1, 2], start_s=1e4) for kind in ("stops", "solver-failure")]],
    ids=["links", "minds"],
)
def test_a_run_whose_faults_never_strike_is_the_run_without_them(
    healthy: list[Step], never: list[dict[str, Any]]
) -> None:
    assert healthy[-1].truth.verdict == "arrived"
    disturbed = drive(*never)
    assert truths(disturbed) == truths(healthy)
    for one, other in zip(disturbed, healthy, strict=True):
        assert (one.commands, one.observations) == (other.commands, other.observations)
        plans = ({name: each.mind.plan for name, each in step.decisions.items()} for step in (one, other))
        assert next(plans) == next(plans)


def test_without_faults_nothing_stands_between_the_world_and_its_robots(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("fleet.run.virtual.encode", None)
    assert len(drive(time_limit_s=0.2)) == 3
    with pytest.raises(TypeError):
        drive(NEVER, time_limit_s=0.2)


MIXED = [
    fault("loss", rate=0.2),
    fault("jitter", steps=2),
    fault("garbage", rate=0.1, robots=[1]),
    fault("command-loss", rate=0.2),
    fault("jump", seen=2, distance_m=0.3, rate=0.1),
    fault("freeze", robots=[2], start_s=[0.3, 0.9], duration_s=0.3),
    fault("solver-failure", rate=0.1),
]


def test_the_seed_and_nothing_else_decides_a_run_with_faults() -> None:
    one, again, other = (truths(drive(*MIXED, seed=seed, time_limit_s=2.0)) for seed in (1, 1, 2))
    assert one == again
    assert one != other


@pytest.mark.parametrize("kind", ["loss", "slow", "nan", "garbage", "wrong-version", "wrong-epoch"])
def test_a_robot_that_gets_nothing_intact_brakes_at_once(healthy: list[Step], kind: str) -> None:
    driven = drive(fault(kind, rate=1.0, robots=[1], start_s=SOON_S), time_limit_s=3.0)
    assert same_until(driven, healthy) == SOON + 1
    brakes(driven, "1")
    assert all("1" not in step.decisions for step in driven[SOON:])
    assert speeds(driven, "1")[-1] == pytest.approx(0.0, abs=1e-6)
    assert truths(driven)[-1].robots["1"].deadline_misses == len(driven) - 1 - SOON


def test_a_robot_that_is_shown_another_epoch_does_not_answer_and_keeps_its_memory() -> None:
    driven = drive(
        fault("wrong-epoch", rate=1.0, robots=[1], start_s=SOON_S, duration_s=0.1), time_limit_s=1.0
    )
    ordinals = [step.decisions["1"].mind.decision if "1" in step.decisions else None for step in driven[:-1]]
    assert ordinals == [*range(SOON), None, *range(SOON, len(driven) - 2)]


@pytest.mark.parametrize(
    "wrong",
    [
        fault("delay", steps=5),
        fault("jitter", steps=8),
        fault("stuck", seen=2),
        fault("ghost", x_m=0.0, y_m=0.0),
        fault("jump", seen=2, distance_m=0.5),
        fault("bias", seen=2, x_m=0.0, y_m=-0.4),
        fault("bias", seen=1, x_m=0.0, y_m=0.2),
        fault("command-delay", steps=1, rate=0.5),
        fault("command-excess"),
        fault("weak", factor=0.2),
        fault("other-cost", weights={"x": 0.2, "y": 5.0}),
        fault("turns-back"),
        fault("chases", seen=2),
        fault("stops"),
        fault("infeasible"),
        fault("solver-failure", rate=0.5),
        fault("reordering", rate=1.0),
    ],
    ids=lambda wrong: wrong["kind"],
)
def test_a_fault_changes_the_run_from_its_beginning_on(healthy: list[Step], wrong: dict[str, Any]) -> None:
    driven = drive({**wrong, "robots": [1], "start_s": SOON_S}, time_limit_s=1.4)
    assert SOON < same_until(driven, healthy) < SOON + 8


def test_a_duplicate_observation_changes_nothing(healthy: list[Step]) -> None:
    assert truths(drive(fault("duplication", rate=1.0))) == truths(healthy)


def test_commands_that_do_not_count_are_counted_by_the_world() -> None:
    driven = drive(
        fault("command-duplication", rate=1.0, robots=[1]),
        fault("command-delay", steps=2, robots=[2]),
        time_limit_s=1.5,
    )
    steps = len(driven) - 1
    refused = driven[-1].truth.refused
    assert refused["1"] == {"answers a step again": steps}
    assert refused["2"] == {"answers another step": steps - 2}
    assert driven[-1].truth.robots["2"].deadline_misses == steps
    assert driven[3].truth.refused == {"1": {"answers a step again": 3}, "2": {"answers another step": 1}}
    assert [command.step for command in driven[3].commands["2"]] == [1, 3]


# Processes.


def test_a_killed_robot_decides_no_more_and_its_safe_stop_follows(healthy: list[Step]) -> None:
    driven = drive(fault("kill", robots=[1], start_s=SOON_S), time_limit_s=3.0)
    assert same_until(driven, healthy) == SOON + 1
    assert ["1" in step.decisions for step in driven[:-1]] == [True] * SOON + [False] * (
        len(driven) - 1 - SOON
    )
    brakes(driven, "1")
    assert speeds(driven, "1")[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("kind", "goes_on_with"), [("kill", 0), ("freeze", SOON)])
def test_a_robot_goes_on_with_its_memory_after_a_stop_and_without_it_after_a_new_start(
    kind: str, goes_on_with: int
) -> None:
    driven = drive(fault(kind, robots=[1], start_s=SOON_S, duration_s=0.4))
    ordinals = [step.decisions["1"].mind.decision if "1" in step.decisions else None for step in driven[:-1]]
    back = len(ordinals) - SOON - 4
    assert ordinals == [*range(SOON), *[None] * 4, *range(goes_on_with, goes_on_with + back)]
    assert driven[-1].truth.verdict == "arrived"


def test_the_world_starts_again_once_from_its_first_step_in_the_next_epoch(healthy: list[Step]) -> None:
    driven = drive(fault("restart-world", start_s=SOON_S, duration_s=7.0))
    before, after = driven[: SOON + 1], driven[SOON + 1 :]
    assert [(truth.epoch, truth.step) for truth in truths(before)] == [(0, step) for step in range(SOON + 1)]
    assert (before[-1].decisions, before[-1].truth.verdict) == ({}, None)
    assert [truth.model_copy(update={"epoch": 0}) for truth in truths(after)] == truths(healthy)
    assert {each.command.epoch for step in after for each in step.decisions.values()} == {1}


def test_processes_break_once_though_the_world_starts_again() -> None:
    driven = drive(
        fault("kill", robots=[1], start_s=0.2, duration_s=0.5),
        fault("restart-world", start_s=0.4),
        time_limit_s=1.0,
    )
    down = [(step.truth.epoch, step.truth.step) for step in driven[:-1] if "1" not in step.decisions]
    assert down == [(0, 2), (0, 3), (0, 4), (1, 0), (1, 1)]


def test_the_machine_and_the_wall_clock_mean_nothing_in_virtual_time(healthy: list[Step]) -> None:
    nothing = [fault("pause", start_s=0.3), fault("clock-step", offset_s=3600.0), fault("disk-full")]
    assert truths(drive(*nothing, fault("recorder-dies"))) == truths(healthy)


# Robots that are not there.


def test_a_robot_that_arrives_late_is_not_there_before() -> None:
    driven = drive(fault("arrives-late", robots=[2], start_s=SOON_S))
    for step in driven[:-1]:
        there = {"1", "2"} if step.truth.step >= SOON else {"1"}
        assert set(step.truth.robots) == set(step.observations) == set(step.decisions) == there
        assert set(step.observations["1"].robots) == there
    assert driven[-1].truth.verdict == "arrived"


def test_a_robot_that_leaves_comes_back_where_it_left_or_is_not_awaited() -> None:
    alone = drive(fault("leaves", robots=[2], start_s=SOON_S))[-1].truth
    assert (alone.verdict, set(alone.robots)) == ("arrived", {"1"})
    driven = drive(fault("leaves", robots=[2], start_s=SOON_S, duration_s=0.6))
    assert ["2" in truth.robots for truth in truths(driven)[:13]] == [True] * 5 + [False] * 6 + [True] * 2
    before, after = (truths(driven)[step].robots["2"].state for step in (SOON - 1, SOON + 6))
    assert math.hypot(after.x_m - before.x_m, after.y_m - before.y_m) < 0.2
    assert driven[-1].truth.verdict == "arrived"


def test_an_interruption_ends_a_run_with_faults() -> None:
    driven = list(closed_loop(scenario(NEVER), facts(), lambda: 0.0, lambda: True))
    assert [(truth.step, truth.verdict) for truth in truths(driven)] == [(0, None), (0, "interrupted")]


@pytest.mark.parametrize("goals", ["joint-fit", "constant-velocity"])
def test_faults_befall_other_methods_as_well(goals: str) -> None:
    driven = list(run(scenario(*MIXED, time_limit_s=1.0), facts(1, goals=goals)))
    assert driven[-1].truth.verdict == "timeout"
    assert sum(robot.deadline_misses for robot in driven[-1].truth.robots.values()) > 0
