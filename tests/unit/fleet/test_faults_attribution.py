"""Whose collision it was, in truths made up for it."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import pytest
from run_helpers import truth

from fleet.faults.attribution import Avoidable, avoidable_collisions
from protocol.messages import State
from protocol.scene import PublicRobot, Scene
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input
from world.vehicle import VehicleState, drive

STEP_S = 0.1
SCENE = Scene(step_s=STEP_S, robots=dict.fromkeys("ab", PublicRobot()))
LEAST_M = SCENE.collision_distance_m("a", "b")
LIMITS = Limits()
STEPS = 60


class Moving(NamedTuple):
    """A vehicle at a step, with the input that led there."""

    state: VehicleState
    applied: Input


Way = Sequence[Moving | None]
"""Of a robot by the step; None where it is not in the scene."""


def way(
    x_m: float, y_m: float, heading_rad: float, speed_mps: float, *, braking_from: int = STEPS, since: int = 0
) -> Way:
    """Straight on, and braking from a step on; at the place given when it comes into the scene."""
    moving = Moving(VehicleState(x_m, y_m, heading_rad, speed_mps), STANDSTILL)
    found: list[Moving | None] = [None] * since
    for step in range(since, STEPS):
        found.append(moving)
        moving = _braked(moving) if step >= braking_from else _driven(moving, Input(0.0, 0.0))
    return found


def standing(x_m: float, y_m: float, *, since: int = 0) -> Way:
    return way(x_m, y_m, 0.0, 0.0, since=since)


def _driven(moving: Moving, wanted: Input) -> Moving:
    return Moving(*drive(LIMITS, moving.state, moving.applied, wanted, STEP_S)[:2])


def _braked(moving: Moving) -> Moving:
    return _driven(moving, braking_input(LIMITS, moving.applied, moving.state.speed_mps, STEP_S))


def distance_m(one: Moving, other: Moving) -> float:
    return math.dist(one.state[:2], other.state[:2])


def contact_of(one: Way, other: Way) -> int:
    """The first step at which both are too near."""
    pairs = enumerate(zip(one, other, strict=True))
    return next(step for step, (a, b) in pairs if a and b and distance_m(a, b) < LEAST_M)


def last_chance(braking: Way, other: Way) -> int:
    """Found by trying: the last step at which braking keeps a robot out of it."""
    contact = contact_of(braking, other)
    return max(step for step in range(contact) if _keeps_clear(braking[step], other, step))


def _keeps_clear(moving: Moving | None, other: Way, since: int) -> bool:
    for there in other[since:]:
        assert moving is not None
        if there and distance_m(moving, there) < LEAST_M:
            return False
        moving = _braked(moving)
    return True


@pytest.fixture
def blamed() -> Callable[..., list[Avoidable]]:
    def of(ways: Mapping[str, Way], healthy: str = "ab") -> list[Avoidable]:
        contact = contact_of(ways["a"], ways["b"])
        truths = [
            truth(
                step,
                {name: _told(each[step]) for name, each in ways.items() if each[step]},
                collisions=(("a", "b"),) if step >= contact else (),
            )
            for step in range(STEPS)
        ]
        return avoidable_collisions(truths, SCENE, healthy)

    return of


def _told(moving: Moving | None) -> dict[str, Any]:
    assert moving is not None
    turn_rate, acceleration = moving.applied
    return {
        "state": State.of(*moving.state),
        "turn_rate_radps": turn_rate,
        "acceleration_mps2": acceleration,
    }


Blamed = Callable[..., list[Avoidable]]


def test_who_drives_into_somebody_that_stands_could_have_braked_and_the_other_is_not_to_blame(
    blamed: Blamed,
) -> None:
    ways = {"a": standing(0.0, 0.0), "b": way(-6.0, 0.0, 0.0, 2.0)}
    chance, contact = last_chance(ways["b"], ways["a"]), contact_of(ways["a"], ways["b"])
    assert contact == 26, "6 m, less 0.99 m, at 0.2 m a step"
    assert contact - 12 < chance < contact - 5, "2 m/s are braked within less than 1.2 s"
    assert blamed(ways) == [Avoidable("b", "a", contact, chance)]
    late = {**ways, "b": way(-6.0, 0.0, 0.0, 2.0, braking_from=chance + 1)}
    assert [(each.robot, each.last_chance) for each in blamed(late)] == [("b", chance)], "braked too late"


def test_of_two_that_cross_each_other_blindly_each_could_have_braked(blamed: Blamed) -> None:
    ways = {"a": way(-6.0, 0.0, 0.0, 3.0), "b": way(0.0, -5.5, math.pi / 2, 3.0)}
    contact = contact_of(ways["a"], ways["b"])
    assert blamed(ways) == [
        Avoidable(one, other, contact, last_chance(ways[one], ways[other])) for one, other in ("ab", "ba")
    ]


@pytest.mark.parametrize(
    ("a", "b", "robots"),
    [
        # b comes from behind.
        (way(0.0, 0.0, 0.0, 1.0), way(-5.0, 0.0, 0.0, 3.0), "b"),
        # Head on: both could see it coming, and a did what it could.
        (way(-6.0, 0.0, 0.0, 2.0, braking_from=20), way(9.0, 0.0, math.pi, 2.0), "b"),
        # Braking only puts it off: b comes on, and would have been there within a second.
        (way(-6.0, 0.0, 0.0, 0.5), way(3.0, 0.0, math.pi, 4.0), "b"),
        # a comes into the scene right before b; whether that brakes then makes no difference.
        (standing(0.0, 0.0, since=10), way(-5.0, 0.0, 0.0, 3.0), ""),
        (standing(0.0, 0.0, since=10), way(-5.0, 0.0, 0.0, 3.0, braking_from=10), ""),
    ],
    ids=["from behind", "stands already", "put off", "no time", "no time to brake"],
)
def test_who_could_not_have_braked_in_time_is_not_to_blame(
    blamed: Blamed, a: Way, b: Way, robots: str
) -> None:
    found = blamed({"a": a, "b": b})
    assert [each.robot for each in found] == list(robots)
    assert all(each.last_chance < each.step for each in found)
    assert blamed({"a": a, "b": b}, healthy="a") == []


def test_nobody_has_to_brake_for_who_passes_by_until_it_turns(blamed: Blamed) -> None:
    """Had robot a braked before, there would have been no collision; but nothing told it to."""
    beside = way(-6.0, 1.5, 0.0, 2.0)[:20]
    last = beside[-1]
    assert last is not None
    x_m, y_m, _, speed_mps = last.state
    turned = way(x_m, y_m, -math.pi / 4, math.sqrt(2.0) * speed_mps, since=20)
    ways = {"a": way(-6.0, 0.0, 0.0, 2.0), "b": [*beside, *turned[20:]]}
    assert contact_of(ways["a"], ways["b"]) in range(21, 25)
    assert blamed(ways) == []
