"""Whatever is changed in a recording is found, and the place is named."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from auditing_helpers import MEETING, STEPS, audited, experiment_of, simulated, write

from fleet.audit.recorded import compared, open_run
from fleet.audit.replay import Report, RobotReplay
from fleet.record.experiment import Experiment
from fleet.record.recording import BusMessage
from protocol.keys import Keys
from protocol.messages import Accuracy, Observation, State
from protocol.scene import Scene

STEP = 5
Messages = list[BusMessage]


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return experiment_of(
        tmp_path_factory.mktemp("experiment"), "constant-acceleration", sensing={"position_noise_m": 0.001}
    )


@pytest.fixture(scope="module")
def honest(experiment: Experiment) -> Messages:
    return simulated(experiment)


def at(messages: Messages, what: str, step: int | None = STEP) -> int:
    """Where the message of a step stands, such as that of ``pose/1``."""
    [index] = [
        index
        for index, (key, message, _) in enumerate(messages)
        if key.split("/", 2)[2] == what and getattr(message, "step", None) == step
    ]
    return index


def changing(what: str, at_step: int | None = STEP, /, **changes: Any) -> Any:
    """Change fields of one message, to a value or by a function of the former one."""

    def tamper(messages: Messages) -> None:
        index = at(messages, what, at_step)
        message = messages[index].message
        update = {
            name: change(getattr(message, name)) if callable(change) else change
            for name, change in changes.items()
        }
        changed = type(message).model_validate(message.model_copy(update=update).model_dump())
        messages[index] = messages[index]._replace(message=changed)

    return tamper


def without(what: str) -> Any:
    return lambda messages: messages.pop(at(messages, what))


def twice(what: str) -> Any:
    return lambda messages: messages.append(messages[at(messages, what)])


def next_after(value: float) -> float:
    """One bit more."""
    return math.nextafter(value, math.inf)


def nudged(robots: dict[str, State]) -> dict[str, State]:
    return {**robots, "1": robots["1"].model_copy(update={"x_m": next_after(robots["1"].x_m)})}


def with_goals(scene: Scene) -> Scene:
    goals = {str(robot["id"]): {**robot["goal"], "heading_rad": 0.0} for robot in MEETING}
    return Scene.model_validate({**scene.model_dump(), "goals": goals})


def driven_further(robots: dict[str, Any]) -> dict[str, Any]:
    return {**robots, "2": robots["2"].model_copy(update={"driven_m": robots["2"].driven_m + 1e-9})}


def bent(plan: Any) -> Any:
    (x_m, y_m), *others = plan
    return ((next_after(x_m), y_m), *others)


GHOST = State.of(5.0, 5.0, 0.0, 0.0)
TAMPERINGS = {
    "a command": (changing("command/1", turn_rate_radps=next_after), "command 1 turn_rate_radps"),
    "an observation": (changing("pose/2", robots=nudged), "observation 2 robots.1.x_m"),
    "one more robot": (
        changing("pose/2", robots=lambda all_: {**all_, "3": GHOST}),
        "observation 2 robots.3",
    ),
    "an order": (
        changing("pose/2", robots=lambda all_: dict(reversed(all_.items()))),
        "observation 2 robots",
    ),
    "an accuracy": (changing("pose/1", accuracy=Accuracy()), "observation 1 accuracy.position_m"),
    "an epoch": (changing("pose/1", epoch=9), "observation 1 epoch"),
    "goals in the scene": (changing("scene", None, scene=with_goals), "scene None scene.goals"),
    "a mind": (changing("mind/1", plan=bent), "mind 1 plan.0.0"),
    "the count of a mind": (changing("mind/1", decision=lambda count: count + 1), "mind 1 decision"),
    "a mind that forgets": (changing("mind/1", decision=0), "mind 1"),
    "a truth": (changing("truth", robots=driven_further), "truth None robots.2.driven_m"),
    "a missing observation": (without("pose/2"), "observation 2"),
    "a missing command": (without("command/2"), "command 2"),
    "a missing mind": (without("mind/2"), "command 2"),
    "a missing truth": (without("truth"), "truth None step"),
    "an observation twice": (twice("pose/1"), "observation 1"),
    "a command twice": (twice("command/1"), "command 1"),
    "a mind twice": (twice("mind/1"), "mind 1"),
    "a truth twice": (twice("truth"), "truth None"),
    "an observation after the end": (changing("pose/1", step=STEPS + 1), "observation 1"),
}
"""By what is changed: how, and the part, the robot and the field that are named."""


@pytest.fixture
def audit(tmp_path: Path, experiment: Experiment) -> Callable[[Messages], Report]:
    """Record these messages and repeat them."""
    return lambda messages: audited(write(tmp_path / "run.mcap", experiment, messages))


def first(report: Report) -> tuple[str, str | None, int | None, str]:
    assert report.result == "differs"
    difference = report.differences[0]
    return difference.part, difference.robot, difference.step, difference.field


@pytest.mark.parametrize(("tamper", "where"), TAMPERINGS.values(), ids=TAMPERINGS)
def test_what_was_changed_is_found_and_named(audit: Any, honest: Messages, tamper: Any, where: str) -> None:
    messages = list(honest)
    tamper(messages)
    part, robot, step, field = first(audit(messages))
    assert f"{part} {robot} {field}".startswith(where)
    assert step == (None if part == "scene" else STEP)


def test_what_a_changed_command_leads_to_differs_too(audit: Any, honest: Messages) -> None:
    messages = list(honest)
    changing("command/1", acceleration_mps2=lambda recorded: recorded - 0.1)(messages)
    report = audit(messages)
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
    audit: Any, honest: Messages
) -> None:
    messages = list(honest)
    index = at(messages, "command/1")
    refused = messages[index].message.model_copy(update={"robot": "2"})
    messages.insert(index, messages[index]._replace(message=refused))
    report = audit(messages)
    assert first(report) == ("command", "1", STEP, "robot")
    assert {each.part for each in report.differences} == {"command"}


@pytest.mark.parametrize(("key", "whose"), [("pose/3", "pose/1"), ("pose/1", "mind/2")])
def test_a_key_or_a_kind_of_message_that_has_no_place_in_the_run_is_named(
    audit: Any, experiment: Experiment, honest: Messages, key: str, whose: str
) -> None:
    stray = f"unspoken/{experiment.facts.run}/{key}"
    messages = [*honest, honest[at(honest, whose)]._replace(key=stray)]
    assert first(audit(messages)) == ("key", None, None, stray)


def test_without_one_scene_nothing_can_be_repeated_and_nothing_but_a_scene_does_not_follow(
    audit: Any, honest: Messages
) -> None:
    scene, *others = honest
    for messages in (others, [scene, scene, *others]):
        report = audit(messages)
        assert first(report) == ("scene", None, None, "")
        assert report.robots == ()
    assert first(audit([scene]))[0] == "truth"


def test_a_robot_is_repeated_without_anything_that_concerns_the_others(
    tmp_path: Path, experiment: Experiment, honest: Messages
) -> None:
    keys = Keys(experiment.facts.run)
    own = {keys.scene, keys.pose("1"), keys.mind("1"), keys.command("1")}
    messages = [message for message in honest if message.key in own]
    turns = list(RobotReplay(open_run(write(tmp_path / "run.mcap", experiment, messages)), "1").turns())
    assert len(turns) == STEPS
    assert [turn.differences for turn in turns] == STEPS * [[]]


def test_zero_and_negative_zero_differ() -> None:
    zero, negative = (Accuracy(position_m=value) for value in (0.0, -0.0))
    observation = Observation(epoch=0, step=0, time_s=0.0, robots={}, accuracy=zero)
    [difference] = compared("observation", observation, observation.model_copy(update={"accuracy": negative}))
    assert difference.field == "accuracy.position_m"
    assert (difference.recorded, difference.repeated) == ("0.0", "-0.0")
