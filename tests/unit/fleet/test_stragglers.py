"""Which commands the bench still waits for when the verdict is there."""

from collections.abc import Callable

import pytest

from fleet.run.listening import Outstanding
from protocol.messages import Command, Truth

MakeTruth = Callable[..., Truth]


def command(robot: str, step: int) -> Command:
    return Command(epoch=7, robot=robot, step=step, turn_rate_radps=0.0, acceleration_mps2=0.0)


@pytest.fixture
def stragglers(make_truth: MakeTruth) -> Outstanding:
    """At step 4, where two robots have answered every step but the last."""
    stragglers = Outstanding()
    stragglers.add(make_truth(3, {"1": {}, "2": {}}))
    for robot in ("1", "2"):
        stragglers.add(command(robot, 3))
    stragglers.add(make_truth(4, {"1": {}, "2": {}}))
    return stragglers


def test_nothing_is_awaited_while_all_commands_are_there(stragglers: Outstanding) -> None:
    assert not stragglers.on_their_way()


def test_a_command_is_awaited_that_the_truth_has_overtaken(
    stragglers: Outstanding, make_truth: MakeTruth
) -> None:
    stragglers.add(command("2", 4))
    stragglers.add(make_truth(5, {"1": {}, "2": {}}, verdict="arrived"))
    assert stragglers.on_their_way()
    stragglers.add(command("1", 4))
    assert not stragglers.on_their_way()


def test_a_robot_that_missed_the_step_is_not_awaited(stragglers: Outstanding, make_truth: MakeTruth) -> None:
    stragglers.add(command("2", 4))
    stragglers.add(make_truth(5, {"1": {"deadline_misses": 1}, "2": {}}, verdict="arrived"))
    assert not stragglers.on_their_way()


def test_nobody_is_awaited_at_an_interrupted_step(stragglers: Outstanding, make_truth: MakeTruth) -> None:
    stragglers.add(make_truth(4, {"1": {}, "2": {}}, verdict="interrupted"))
    assert not stragglers.on_their_way()


def test_nobody_is_awaited_before_the_first_step(make_truth: MakeTruth) -> None:
    stragglers = Outstanding()
    stragglers.add(make_truth(0, {"1": {}, "2": {}}, verdict="interrupted"))
    assert not stragglers.on_their_way()


def test_nothing_of_a_former_world_is_awaited(stragglers: Outstanding, make_truth: MakeTruth) -> None:
    stragglers.add(make_truth(0, {"1": {}, "2": {}}).model_copy(update={"epoch": 8}))
    assert not stragglers.on_their_way()
    stragglers.add(make_truth(1, {"1": {}, "2": {}}).model_copy(update={"epoch": 8}))
    assert stragglers.on_their_way()
    stragglers.add(command("1", 0))
    stragglers.add(command("2", 0))
    assert stragglers.on_their_way(), "these answered the former world"
