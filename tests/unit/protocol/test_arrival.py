"""The arrival rule: the norm over the full state, headings compared on the circle."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.arrival import has_arrived, nearest_turn, wrap_angle

ANGLES = st.floats(-100, 100)
GOAL = (4.0, -4.0, 3.0, 0.0)


def same_direction(one: float, other: float) -> bool:
    return math.dist((math.cos(one), math.sin(one)), (math.cos(other), math.sin(other))) < 1e-9


@given(ANGLES)
def test_wrapping_keeps_the_direction_and_lies_within_half_a_turn(angle: float) -> None:
    assert abs(wrap_angle(angle)) <= math.pi
    assert same_direction(wrap_angle(angle), angle)


@given(ANGLES, ANGLES)
def test_the_nearest_turn_keeps_the_direction_and_lies_within_half_a_turn_of_the_reference(
    angle: float, reference: float
) -> None:
    turned = nearest_turn(angle, reference)
    assert abs(turned - reference) <= math.pi + 1e-9
    assert same_direction(turned, angle)


@pytest.mark.parametrize("component", range(4))
@pytest.mark.parametrize("sign", [-1, 1])
def test_each_component_alone_may_be_off_by_the_tolerance(component: int, sign: int) -> None:
    for error, arrived in ((0.0999, True), (0.1001, False)):
        state = list(GOAL)
        state[component] += sign * error
        assert has_arrived(state, GOAL, 0.1) is arrived


def test_the_errors_of_all_components_add_up_as_a_norm_and_not_as_its_square() -> None:
    for each, arrived in ((0.0499, True), (0.0501, False)):  # four errors of half the tolerance have its norm
        state = tuple(value + each for value in GOAL)
        assert has_arrived(state, GOAL, 0.1) is arrived


@given(st.integers(-20, 20))
def test_whole_turns_of_the_heading_do_not_matter(turns: int) -> None:
    x, y, heading, speed = GOAL
    assert has_arrived((x, y, heading + turns * math.tau, speed), GOAL, 0.1)
    assert not has_arrived((x, y, heading + math.pi + turns * math.tau, speed), GOAL, 0.1)


def test_headings_on_both_sides_of_half_a_turn_are_neighbours() -> None:
    assert has_arrived((0, 0, math.pi - 0.03, 0), (0, 0, -math.pi + 0.03, 0), 0.1)
