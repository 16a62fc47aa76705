"""How near robots come relative to what they should, and on which sides two minds pass: counted by hand."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from run_helpers import EPOCH, mind, truth

from fleet.record.encounters import LATE_STEPS, Encounters, pooled, winding_rad
from fleet.record.summary import Tally
from protocol.messages import Message, PublicScene, State
from protocol.scene import PublicRobot, Scene

SCENE = Scene(
    robots={"a": PublicRobot(radius_m=0.5), "b": PublicRobot(radius_m=0.3), "c": PublicRobot(radius_m=0.2)},
    safety_margin_m=0.1,
)
"""Contact of a and b at 0.8 m, safety at 1 m."""
Line = tuple[tuple[float, float], ...]


def at(**places: tuple[float, float]) -> dict[str, dict[str, object]]:
    return {
        name: {"state": State(x_m=x_m, y_m=y_m, heading_rad=0.0, speed_mps=0.0)}
        for name, (x_m, y_m) in places.items()
    }


def straight(start: tuple[float, float], end: tuple[float, float]) -> Line:
    return tuple(
        tuple(here + share / 4.0 * (there - here) for here, there in zip(start, end, strict=True))
        for share in range(5)
    )


def head_on(robot: str, step: int, offset_m: float, **changes: object) -> Message:
    """What a robot thinks while a drives to the right, and b to the left, b higher by so much."""
    prediction = {"a": straight((-4, 0), (4, 0)), "b": straight((4, offset_m), (-4, offset_m))}
    return mind(robot, step, prediction=prediction, **changes)


def gathered(messages: Sequence[Message]) -> Encounters:
    tally = Tally()
    tally.add(PublicScene(epoch=EPOCH, scene=SCENE))
    for message in messages:
        tally.add(message)
    return tally._encounters


def test_distances_are_those_of_the_nearest_pair_at_each_step_relative_to_its_own_bodies() -> None:
    far = (9.0, 9.0)
    met = gathered(
        [
            *(truth(step, at(a=(0.0, 0.0), b=(4.0, 0.0), c=far)) for step in range(100)),
            truth(100, at(a=(0.0, 0.0), b=(0.6, 0.0), c=far)),  # a and b overlap by a quarter
        ]
    )
    distances = met.relative_distances
    assert distances is not None
    assert distances.to_collision.model_dump() == pytest.approx(
        {"min": 0.75, "p1": 5.0, "p10": 5.0, "p50": 5.0}
    )
    assert distances.to_safety.min == pytest.approx(0.6)
    # The smaller robot is nearer than the larger one, and yet has more room relative to its body.
    met = gathered([truth(0, at(a=(0.0, 0.0), b=(1.6, 0.0), c=(-1.5, 0.0)))])
    assert met.relative_distances is not None
    assert met.relative_distances.to_collision.min == pytest.approx(2.0)


def test_the_line_of_sight_turns_to_the_left_where_the_other_is_on_the_left() -> None:
    here, there = straight((-4, 0), (4, 0)), straight((4, 1), (-4, 1))
    path = np.array([complex(*b) - complex(*a) for a, b in zip(here, there, strict=True)])
    assert winding_rad(path) == pytest.approx(math.pi - 2.0 * math.atan2(1.0, 8.0))
    assert winding_rad(-path) > 0.0, "and so the other one sees it"


@pytest.mark.parametrize(
    ("minds", "expected"),
    [
        ([head_on("a", 0, 0.5), head_on("b", 0, 0.5)], (1, 0.0)),
        ([head_on("a", 0, 0.5), head_on("b", 0, -0.5)], (1, 1.0)),
        ([head_on("a", 0, 0.5), head_on("b", 0, -9.0)], (1, 1.0)),  # near enough in one of both minds
        ([head_on("a", 0, 2.1), head_on("b", 0, -2.1)], (0, None)),  # nobody comes near
        ([head_on("a", 0, 0.5), head_on("b", 1, -0.5)], (0, None)),  # of different steps
        ([head_on("a", 0, 0.5), mind("b", 0)], (0, None)),  # a baseline predicts nothing
        ([head_on("a", 0, 0.5, arrived=True), head_on("b", 0, -0.5)], (1, 1.0)),
        ([head_on("a", 0, 0.5, arrived=True), head_on("b", 0, -0.5, arrived=True)], (0, None)),
        (
            [head_on("a", 0, 0.5), *(head_on("a", step, 0.5) for step in (1, 2)), head_on("b", 0, 0.5)],
            (1, 0.0),  # a mind that comes late
        ),
        ([head_on("a", 0, 0.5), head_on("a", LATE_STEPS + 1, 0.5), head_on("b", 0, 0.5)], (0, None)),
    ],
)
def test_two_minds_of_a_step_disagree_where_they_pass_on_different_sides(
    minds: Sequence[Message], expected: tuple[int, float | None]
) -> None:
    met = gathered(minds)
    assert (met.pair_steps, met.side_disagreement) == expected


def test_shares_of_several_runs_are_pooled_by_what_they_are_shares_of() -> None:
    assert pooled([(0.5, 30), (None, 0), (0.0, 10)]) == 0.375
    assert pooled([(None, 0)]) is None


def test_another_epoch_begins_anew_among_the_same_robots() -> None:
    first: Mapping[str, Message] = {name: head_on(name, 0, 0.5) for name in "ab"}
    again = [truth(0, at(a=(0.0, 0.0), b=(4.0, 0.0)), epoch=EPOCH + 1)]
    again += [head_on(name, 0, offset_m, epoch=EPOCH + 1) for name, offset_m in (("a", 0.5), ("b", -0.5))]
    met = gathered([*first.values(), *again])
    assert (met.pair_steps, met.side_disagreement) == (1, 1.0)
