"""Whatever is changed in a recording is found, and the place is named."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from auditing_helpers import MEETING, STEPS, audited, experiment_of, opened, simulated, write

from fleet.audit.audit import Report
from fleet.audit.command import conclusion
from fleet.audit.difference import compared
from fleet.audit.replay import RobotReplay
from fleet.record.stream import BusMessage
from fleet.run.experiment import Experiment
from protocol.keys import Keys
from protocol.messages import Accuracy, Observation, State
from protocol.scene import Scene

STEP = 5
Messages = list[BusMessage]


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return experiment_of(tmp_path_factory.mktemp("experiment"), sensing={"position_noise_m": 0.001})


@pytest.fixture(scope="module")
def honest(experiment: Experiment) -> Messages:
    return simulated(experiment)


def kind_and_robot(message: BusMessage) -> str:
    return message.key.split("/", 2)[2]


def at(messages: Messages, what: str, step: int | None = STEP) -> int:
    """Where the message of a step stands, such as that of ``pose/1``."""
    [index] = [
        index
        for index, message in enumerate(messages)
        if kind_and_robot(message) == what and getattr(message.message, "step", None) == step
    ]
    return index


def changing(what: str, change: Callable[[Any], dict[str, Any]], step: int | None = STEP) -> Any:
    """Change fields of one message."""

    def tamper(messages: Messages) -> None:
        index = at(messages, what, step)
        message = messages[index].message
        changed = type(message).model_validate(message.model_copy(update=change(message)).model_dump())
        messages[index] = messages[index]._replace(message=changed)

    return tamper


def without(what: str) -> Any:
    return lambda messages: messages.pop(at(messages, what))


def twice(what: str) -> Any:
    return lambda messages: messages.append(messages[at(messages, what)])


def one_more_robot(observation: Observation) -> dict[str, Any]:
    return {"robots": {**observation.robots, "3": State.of(5.0, 5.0, 0.0, 0.0)}}


def nudged(observation: Observation) -> dict[str, Any]:
    state = observation.robots["1"]
    return {"robots": {**observation.robots, "1": state.model_copy(update={"x_m": next_after(state.x_m)})}}


def next_after(value: float) -> float:
    """One bit more."""
    return math.nextafter(value, math.inf)


def in_another_order(observation: Observation) -> dict[str, Any]:
    return {"robots": dict(reversed(observation.robots.items()))}


def with_goals(public: Any) -> dict[str, Any]:
    goals = {str(robot["id"]): {**robot["goal"], "heading_rad": 0.0} for robot in MEETING}
    return {"scene": Scene.model_validate({**public.scene.model_dump(), "goals": goals})}


def another_truth(truth: Any) -> dict[str, Any]:
    robot = truth.robots["2"]
    return {"robots": {**truth.robots, "2": robot.model_copy(update={"driven_m": robot.driven_m + 1e-9})}}


def another_plan(mind: Any) -> dict[str, Any]:
    (x_m, y_m), *others = mind.plan
    return {"plan": ((next_after(x_m), y_m), *others)}


TAMPERINGS = {
    "a command": (
        changing("command/1", lambda command: {"turn_rate_radps": next_after(command.turn_rate_radps)}),
        ("command", "1", STEP, "turn_rate_radps"),
    ),
    "what a command says for the next step": (
        changing("command/1", lambda command: {"then": None}),
        ("command", "1", STEP, "then"),
    ),
    "an observation": (changing("pose/2", nudged), ("observation", "2", STEP, "robots.1.x_m")),
    "an observation with one more robot": (
        changing("pose/2", one_more_robot),
        ("observation", "2", STEP, "robots.3"),
    ),
    "the order of an observation": (
        changing("pose/2", in_another_order),
        ("observation", "2", STEP, "robots"),
    ),
    "the accuracy of an observation": (
        changing("pose/1", lambda _: {"accuracy": Accuracy()}),
        ("observation", "1", STEP, "accuracy.position_m"),
    ),
    "goals in the scene": (changing("scene", with_goals, None), ("scene", None, None, "scene.goals")),
    "a mind": (changing("mind/1", another_plan), ("mind", "1", STEP, "plan.0.0")),
    "the count of a mind": (
        changing("mind/1", lambda mind: {"decision": mind.decision + 1}),
        ("mind", "1", STEP, "decision"),
    ),
    "a mind that forgets": (changing("mind/1", lambda _: {"decision": 0}), ("mind", "1", STEP, None)),
    "a truth": (changing("truth", another_truth), ("truth", None, STEP, "robots.2.driven_m")),
    "a missing observation": (without("pose/2"), ("observation", "2", STEP, "")),
    "a missing command": (without("command/2"), ("command", "2", STEP, "")),
    "a missing mind": (without("mind/2"), ("command", "2", STEP, "")),
    "a missing truth": (without("truth"), ("truth", None, STEP, "step")),
    "an observation told twice": (twice("pose/1"), ("observation", "1", STEP, "")),
    "a command told twice": (twice("command/1"), ("command", "1", STEP, "")),
    "a mind told twice": (twice("mind/1"), ("mind", "1", STEP, "")),
    "a truth told twice": (twice("truth"), ("truth", None, STEP, None)),
    "an observation after the end": (
        changing("pose/1", lambda _: {"step": STEPS + 1}),
        ("observation", "1", STEP, ""),
    ),
    "another epoch": (changing("pose/1", lambda _: {"epoch": 9}), ("observation", "1", STEP, "epoch")),
}


def first(report: Report) -> tuple[str, str | None, int | None, str]:
    assert report.result == "differs"
    difference = report.differences[0]
    assert str(difference) in conclusion(report)
    return difference.part, difference.robot, difference.step, difference.field


@pytest.mark.parametrize(("tamper", "where"), TAMPERINGS.values(), ids=TAMPERINGS)
def test_what_was_changed_is_found_and_named(
    tmp_path: Path, experiment: Experiment, honest: Messages, tamper: Any, where: tuple[Any, ...]
) -> None:
    messages = list(honest)
    tamper(messages)
    found = first(audited(write(tmp_path / "run.mcap", experiment, messages)))
    assert found[:3] == where[:3]
    assert where[3] in (found[3], None)


def test_a_change_of_one_bit_is_told_with_both_values(
    tmp_path: Path, experiment: Experiment, honest: Messages
) -> None:
    messages = list(honest)
    was = messages[at(messages, "command/1")].message.turn_rate_radps
    TAMPERINGS["a command"][0](messages)
    [told] = audited(write(tmp_path / "run.mcap", experiment, messages)).differences[:1]
    assert (told.recorded, told.repeated) == (repr(next_after(was)), repr(was))


def test_what_a_changed_command_leads_to_differs_too(
    tmp_path: Path, experiment: Experiment, honest: Messages
) -> None:
    messages = list(honest)
    changing("command/1", lambda command: {"acceleration_mps2": command.acceleration_mps2 - 0.1})(messages)
    report = audited(write(tmp_path / "run.mcap", experiment, messages))
    assert {(each.part, each.robot): each.step for each in report.differences} == {
        ("command", "1"): STEP,
        ("truth", None): STEP + 1,
        ("observation", "1"): STEP + 1,
        ("observation", "2"): STEP + 1,
    }
    assert [robot.commands.identical for robot in report.robots] == [STEPS - 1, STEPS]
    assert [robot.minds.identical for robot in report.robots] == [STEPS, STEPS]
    assert [robot.observations.identical for robot in report.robots] == [STEP + 1, STEP + 1]


def test_a_command_that_the_world_refused_differs_but_what_the_world_did_does_not(
    tmp_path: Path, experiment: Experiment, honest: Messages
) -> None:
    messages = list(honest)
    index = at(messages, "command/1")
    refused = messages[index].message.model_copy(update={"robot": "2"})
    messages.insert(index, messages[index]._replace(message=refused))
    report = audited(write(tmp_path / "run.mcap", experiment, messages))
    assert first(report) == ("command", "1", STEP, "robot")
    assert {each.part for each in report.differences} == {"command"}


@pytest.mark.parametrize(
    ("key", "whose"),
    [("pose/3", "pose/1"), ("gossip", "pose/1"), ("pose/1", "mind/2"), ("command/1", "truth")],
)
def test_a_key_or_a_kind_of_message_that_has_no_place_in_the_run_is_named(
    tmp_path: Path, experiment: Experiment, honest: Messages, key: str, whose: str
) -> None:
    stray = f"unspoken/{experiment.facts.run}/{key}"
    messages = [*honest, honest[at(honest, whose)]._replace(key=stray)]
    assert first(audited(write(tmp_path / "run.mcap", experiment, messages))) == ("key", None, None, stray)


@pytest.mark.parametrize("scenes", [0, 2])
def test_without_one_scene_nothing_can_be_repeated(
    tmp_path: Path, experiment: Experiment, honest: Messages, scenes: int
) -> None:
    report = audited(write(tmp_path / "run.mcap", experiment, scenes * honest[:1] + honest[1:]))
    assert first(report) == ("scene", None, None, "")
    assert report.robots == ()


def test_nothing_but_a_scene_does_not_follow(
    tmp_path: Path, experiment: Experiment, honest: Messages
) -> None:
    assert first(audited(write(tmp_path / "run.mcap", experiment, honest[:1])))[0] == "truth"


def test_of_another_version_of_the_software_it_is_told_that_it_may_decide_otherwise(
    tmp_path: Path, experiment: Experiment, honest: Messages
) -> None:
    messages = list(honest)
    TAMPERINGS["a command"][0](messages)
    changed = Experiment(
        experiment.path, experiment.scenario, experiment.facts.model_copy(update={"version": "0.0.0"})
    )
    assert "recorded with version 0.0.0" in conclusion(
        audited(write(tmp_path / "other.mcap", changed, messages))
    )
    assert "version" not in conclusion(audited(write(tmp_path / "same.mcap", experiment, messages)))


def test_a_robot_is_repeated_without_anything_that_concerns_the_others(
    tmp_path: Path, experiment: Experiment, honest: Messages
) -> None:
    keys = Keys(experiment.facts.run)
    own = {keys.scene, keys.pose("1"), keys.mind("1"), keys.command("1")}
    run = opened(tmp_path, experiment, [message for message in honest if message.key in own])
    turns = list(RobotReplay(run, "1", lambda: 0.0).turns())
    assert len(turns) == STEPS
    assert [turn.differences for turn in turns] == STEPS * [[]]


def test_zero_and_negative_zero_differ() -> None:
    zero, negative = (Accuracy(position_m=value) for value in (0.0, -0.0))
    observation = Observation(epoch=0, step=0, time_s=0.0, robots={}, accuracy=zero)
    other = observation.model_copy(update={"accuracy": negative})
    difference = compared("observation", observation, other)
    assert difference is not None
    assert (difference.field, difference.recorded, difference.repeated) == (
        "accuracy.position_m",
        "0.0",
        "-0.0",
    )
