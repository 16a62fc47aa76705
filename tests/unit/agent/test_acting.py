"""From a plan, or from the lack of one, to the input that is commanded, and to the one for the step after."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.drive.commands import failure_input, first_input, second_input
from agent.solve.planning import Plan
from protocol.vehicle import STANDSTILL, Input, Limits

STEP_S = 0.1
inside = st.floats(-1.0, 1.0, allow_subnormal=False)


def plan_with(turn_rate: float, acceleration: float) -> Plan:
    inputs = np.array([[turn_rate, acceleration], [0.4, 2.0]])
    return Plan(inputs, np.zeros((3, 4)), solved=True)


def test_only_the_first_input_of_a_plan_is_driven():
    assert first_input(plan_with(0.03, -0.5), Limits(), STANDSTILL, 1.0, STEP_S) == (0.03, -0.5)


@given(inside, inside, inside, st.floats(-5, 5), st.floats(-5, 5))
def test_what_is_driven_can_be_reached_and_keeps_the_speed_limit(held, rate, share, turn_rate, acceleration):
    """For speeds from which the acceleration can still be taken back in time."""
    limits, previous = Limits(), Input(1.57 * held, 3.0 * rate)
    speed = share * (4.5 - 3.0**2 / 7.0 / 2 - 0.3)
    control = first_input(plan_with(turn_rate, acceleration), limits, previous, speed, STEP_S)
    assert abs(control.turn_rate_radps) <= 1.57
    assert abs(control.acceleration_mps2) <= 3.0
    assert abs(control.turn_rate_radps - previous.turn_rate_radps) <= 0.05 + 1e-12
    assert abs(control.acceleration_mps2 - previous.acceleration_mps2) <= 0.7 + 1e-12
    assert abs(speed + STEP_S * control.acceleration_mps2) <= 4.5


def test_a_speed_beyond_the_limit_is_left_as_fast_as_can_be_reached():
    """As when a speed was observed with noise."""
    control = first_input(plan_with(0.0, 0.0), Limits(), STANDSTILL, 4.8, STEP_S)
    assert control == pytest.approx((0.0, -0.7))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_at_the_speed_limit_the_rest_of_the_way_up_to_it_is_driven(sign):
    """The tolerance of a solver would otherwise lead a rounding error beyond it."""
    plan = plan_with(0.0, sign * 0.5 + sign * 1e-7)
    control = first_input(plan, Limits(), Input(0.0, sign * 1.0), sign * 4.45, STEP_S)
    assert control.acceleration_mps2 == pytest.approx(sign * 0.5, abs=1e-12)
    assert abs(sign * 4.45 + STEP_S * control.acceleration_mps2) <= 4.5 + 1e-12


def test_what_is_said_for_the_step_after_is_the_second_input_of_the_plan():
    plan = plan_with(0.38, 1.5)
    assert second_input(plan, Limits(), Input(0.38, 1.5), 1.0, STEP_S) == (0.4, 2.0)


def test_what_is_said_for_the_step_after_can_be_reached_from_the_first_input_and_keeps_the_speed_limit():
    """From −0.7 m/s² no more than 0; and 4.5 m/s is the limit, of which 4.35 m/s are there after one step."""
    plan = plan_with(0.0, 0.0)
    assert second_input(plan, Limits(), Input(0.1, -0.7), 1.0, STEP_S) == pytest.approx((0.15, 0.0))
    assert second_input(plan, Limits(), Input(0.4, 1.5), 4.2, STEP_S) == pytest.approx((0.4, 1.5))


@pytest.mark.parametrize(
    ("speed_mps", "previous", "expected"),
    [
        (2.0, Input(0.0, 0.0), (-0.05, -0.7)),
        (0.0, Input(0.0, 0.0), (-0.05, -0.7)),
        (-0.1, Input(0.0, 0.0), (0.05, 0.7)),
        (2.0, Input(0.3, -1.0), (0.25, -1.7)),
        (-2.0, Input(0.3, -1.0), (0.35, -0.3)),
        (2.0, Input(-1.56, -2.9), (-1.57, -3.0)),
        (-2.0, Input(1.56, 2.9), (1.57, 3.0)),
    ],
)
def test_failure_input_the_publications_rule_decides(speed_mps, previous, expected):
    """Going forward or standing the lowest reachable inputs, in reverse the highest."""
    assert failure_input(Limits(), previous, speed_mps, STEP_S) == pytest.approx(expected)
