"""The link between the world and one robot, fault by fault."""

import math
from typing import Any

import pytest
from faults_helpers import (
    EPOCH,
    SCENE,
    STEP_S,
    arrived,
    command,
    due,
    fault,
    faults_of,
    given,
    link,
    observation,
    parsed,
    shown,
)
from hypothesis import given as given_any
from hypothesis import strategies as st

from fleet.inject.fault import KINDS, schedule
from fleet.inject.link import LINK_FAULTS, Link
from protocol.codec import MessageError, encode
from protocol.messages import Command, Observation, State
from protocol.scene import PublicRobot, Scene

STEPS = 200


@pytest.mark.parametrize(
    "elsewhere",
    [
        [],
        [fault("loss", rate=1.0, robots=[2])],
        [fault("kill", robots=[1]), fault("stops", robots=[1]), fault("pause")],
        [fault("loss", rate=1.0, start_s=1e4)],
    ],
)
def test_where_no_fault_strikes_every_payload_passes_as_it_is(elsewhere: list[Any]) -> None:
    over = link(*elsewhere)
    for step in range(3):
        assert over.observed(observation(step)) == ((encode(observation(step)),), True)
        assert over.commanded(encode(command(step))) == (encode(command(step)),)
        assert over.due(step) == ()


@pytest.mark.parametrize(
    "kind", ["loss", "slow", "nan", "garbage", "wrong-version", "wrong-epoch", "reordering"]
)
def test_only_a_share_of_the_observations_is_struck_of_each_robot_another(kind: str) -> None:
    one, other = (
        [each.answerable for each in shown(link(fault(kind, rate=0.2), robot=robot), STEPS)] for robot in "12"
    )
    assert 0.1 < one.count(False) / STEPS < 0.3
    assert one != other


@pytest.mark.parametrize(("kind", "ages"), [("delay", {3}), ("jitter", {0, 1, 2, 3})])
def test_an_older_view_is_of_the_others_and_tells_its_age(kind: str, ages: set[int]) -> None:
    came = [each.only for each in shown(link(fault(kind, steps=3)), 40)]
    assert {each.age_steps for each in came[3:]} == ages
    for step, seen in enumerate(came):
        assert seen.robots["1"] == observation(step).robots["1"]
        assert seen.robots["2"] == observation(step - seen.age_steps).robots["2"]


def test_a_delay_adds_to_the_age_that_there_is_and_to_other_delays() -> None:
    over = link(fault("delay", steps=1), fault("delay", steps=1))
    ages = [arrived(over, observation(step, age_steps=min(step, 4))).only.age_steps for step in range(8)]
    assert ages == [0, 1, 2, 3, 4, 5, 6, 6]


@pytest.mark.parametrize(
    ("faults", "came"),
    [
        ([fault("duplication", rate=1.0)], [[0, 0], [1, 1], [2, 2], [3, 3]]),
        ([fault("reordering", rate=1.0)], [[], [1, 0], [], [3, 2]]),
        (
            [
                fault("reordering", rate=1.0, duration_s=0.1),
                fault("loss", rate=1.0, start_s=0.1, duration_s=0.1),
            ],
            [[], [], [2, 0], [3]],
        ),
    ],
    ids=["twice", "after the next one", "after the next one that comes"],
)
def test_observations_come_in_the_order_that_a_fault_gives_them(
    faults: list[Any], came: list[list[int]]
) -> None:
    seen = shown(link(*faults), len(came))
    assert [each.steps for each in seen] == came
    assert [each.answerable for each in seen] == [step in steps for step, steps in enumerate(came)]


def test_a_stuck_robot_stays_in_view_where_it_was_at_the_beginning() -> None:
    stuck = schedule(parsed(fault("stuck", seen=2, start_s=0.2, duration_s=0.3)), seed=0, step_s=STEP_S)
    over, other, own = (Link(stuck, robot, SCENE) for robot in "112")
    there = observation(2).robots["2"]
    for step in range(7):
        unseen = {"1": observation(step).robots["1"]} if step == 4 else observation(step).robots
        seen = arrived(over, observation(step, robots=unseen)).only
        assert seen.robots["2"] == (there if 2 <= step < 5 else observation(step).robots["2"])
    assert arrived(other, observation(4)).only == observation(4), "another link keeps nothing of it"
    assert [each.only for each in shown(own, 3)] == list(map(observation, range(3)))


def test_a_ghost_goes_straight_on_from_its_place() -> None:
    turned = {"heading_rad": math.pi / 2, "speed_mps": 2.0}
    came = shown(link(fault("ghost", x_m=1.0, y_m=-3.0, start_s=0.2, **turned)), 6)
    for step, each in enumerate(came):
        ghosts = {name: state for name, state in each.only.robots.items() if name not in ("1", "2")}
        if step < 2:
            assert ghosts == {}
        else:
            [(name, state)] = ghosts.items()
            assert name == "ghost"
            assert (state.x_m, state.y_m) == pytest.approx((1.0, -3.0 + 0.2 * (step - 2)))
            assert (state.heading_rad, state.speed_mps) == (math.pi / 2, 2.0)


def test_ghosts_have_names_of_nobody_else() -> None:
    scene = Scene(robots={"1": PublicRobot(), "ghost": PublicRobot()})
    over = link(fault("ghost", x_m=1.0, y_m=0.0), fault("ghost", x_m=2.0, y_m=0.0), scene=scene)
    assert set(arrived(over, observation(0)).only.robots) == {"1", "2", "ghost-2", "ghost-3"}


def test_a_robot_jumps_as_far_as_it_is_said_and_elsewhere_each_time() -> None:
    offsets = set()
    for step, each in enumerate(shown(link(fault("jump", seen=2, distance_m=3.0)), 20)):
        seen, true = each.only.robots, observation(step).robots
        assert seen["1"] == true["1"]
        x_m, y_m = seen["2"].x_m - true["2"].x_m, seen["2"].y_m - true["2"].y_m
        assert math.hypot(x_m, y_m) == pytest.approx(3.0)
        offsets.add((round(x_m, 6), round(y_m, 6)))
    assert len(offsets) == 20


@pytest.mark.parametrize(("robot", "other"), ["12", "21"])
def test_a_bias_displaces_others_and_the_observer(robot: str, other: str) -> None:
    for step, each in enumerate(shown(link(fault("bias", seen=robot, x_m=0.5, y_m=-0.25)), 5)):
        seen, true = each.only.robots, observation(step).robots
        assert (seen[robot].x_m, seen[robot].y_m) == (true[robot].x_m + 0.5, true[robot].y_m - 0.25)
        assert seen[other] == true[other]


@pytest.mark.parametrize(
    ("kind", "reason"),
    [("nan", "finite number"), ("garbage", ""), ("wrong-version", "schema_version: 2 found")],
)
def test_what_is_no_valid_observation_is_refused_and_not_to_be_answered(kind: str, reason: str) -> None:
    for each in shown(link(fault(kind, rate=1.0)), 20):
        [error] = each.messages
        assert isinstance(error, MessageError)
        assert reason in str(error)
        assert not each.answerable


def test_an_observation_of_another_epoch_is_valid_and_not_to_be_answered() -> None:
    [each] = shown(link(fault("wrong-epoch", rate=1.0)), 1)
    assert (each.only, each.answerable) == (observation(0, epoch=EPOCH + 1), False)


def test_a_lost_command_is_replaced_by_one_that_is_withheld() -> None:
    over, lost = link(fault("command-loss", rate=0.3)), 0
    for step in range(STEPS):
        [reached] = given(over, command(step))
        assert reached in (command(step), Command.withheld_at(EPOCH, "1", step))
        lost += reached.withheld
    assert 0.2 < lost / STEPS < 0.4


def test_a_delayed_command_comes_later_and_is_withheld_meanwhile() -> None:
    over = link(fault("command-delay", steps=2, duration_s=0.2))
    came = [(due(over, step), given(over, command(step))) for step in range(5)]
    assert [late for late, _ in came] == [[], [], [command(0)], [command(1)], []]
    assert [now for _, now in came[:2]] == [[Command.withheld_at(EPOCH, "1", step)] for step in (0, 1)]
    assert [now for _, now in came[2:]] == [[command(step)] for step in (2, 3, 4)]


def test_a_command_that_is_delayed_and_lost_does_not_come() -> None:
    over = link(fault("command-delay", steps=2), fault("command-loss", rate=1.0))
    assert given(over, command(0)) == [Command.withheld_at(EPOCH, "1", 0)]
    assert due(over, 5) == []


def test_a_duplicated_command_comes_twice() -> None:
    assert given(link(fault("command-duplication", rate=1.0)), command(0)) == [command(0)] * 2


def test_an_excessive_command_is_multiplied_and_still_a_valid_message() -> None:
    over = link(fault("command-excess", factor=10.0))
    excessive = command(0, turn_rate_radps=10.0, acceleration_mps2=20.0)
    assert given(over, command(0)) == [excessive]
    [largest] = given(link(fault("command-excess", factor=1e4)), command(0, acceleration_mps2=-1e5))
    assert largest.acceleration_mps2 == -1e6


def test_a_weak_robot_accelerates_and_brakes_with_a_part_of_its_limits_only() -> None:
    over = link(fault("weak", robots=[1], factor=0.25))  # of 3 m/s²
    assert given(over, command(0)) == [command(0, acceleration_mps2=0.75)]
    assert given(over, command(0, acceleration_mps2=-2.0)) == [command(0, acceleration_mps2=-0.75)]
    gentle = command(1, acceleration_mps2=-0.5)
    assert given(over, gentle) == [gentle]


def test_what_is_no_command_is_left_to_the_world() -> None:
    assert link(fault("command-loss", rate=1.0)).commanded(b"\xc1") == (b"\xc1",)


@given_any(
    faults=st.lists(faults_of([name for name, kind in KINDS.items() if issubclass(kind, LINK_FAULTS)])),
    steps=st.lists(st.integers(1, 4), min_size=1, max_size=12),
    others=st.lists(st.sampled_from(["2", "3"]), unique=True),
)
def test_whatever_befalls_a_link_it_keeps_epochs_and_the_order_of_the_newest(
    faults: list[dict[str, Any]], steps: list[int], others: list[str]
) -> None:
    over, step, newest = link(*faults), 0, -1
    there = State.of(1e6, -1e6, 1.0, 2.0)
    for gap in steps:
        step += gap
        for late in due(over, step):
            assert late.step < step
            assert not late.withheld
        seen = observation(step, robots=dict.fromkeys(["1", *others], there))
        came = arrived(over, seen)
        valid = [message for message in came.messages if isinstance(message, Observation)]
        own = [message for message in valid if message.epoch == EPOCH]
        assert came.answerable == (step in [message.step for message in own])
        assert all(newest < message.step <= step for message in own)
        if came.answerable:
            assert own[0].step == step
            newest = own[-1].step
        else:
            assert own == []
        answers = given(over, command(step))
        assert [answer.step for answer in answers] in ([step], [step, step])
        assert all(answer.epoch == EPOCH and answer.robot == "1" for answer in answers)
