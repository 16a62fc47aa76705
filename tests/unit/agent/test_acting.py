"""From a plan, or from the lack of one, to what is driven at this step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.drive.commands import failure_input, within_reach
from protocol.vehicle import STANDSTILL, Input, Limits

STEP_S = 0.1
SAFE_MPS = 4.5 - 3.0**2 / 7.0 / 2 - 0.3
"""Up to this speed any acceleration can be taken back in time."""
inside = st.floats(-1.0, 1.0, allow_subnormal=False)
wanted = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))


def driven(*inputs: tuple[float, float], previous: Input = STANDSTILL, speed_mps: float = 1.0) -> Input:
    return within_reach(np.array(inputs[0]), Limits(), previous, speed_mps, STEP_S)


@given(inside, inside, inside, wanted)
def test_what_is_driven_can_be_reached_and_keeps_the_speed_limit(held, rate, share, first):
    previous = Input(1.57 * held, 3.0 * rate)
    speed = share * SAFE_MPS
    control = driven(first, previous=previous, speed_mps=speed)
    assert abs(control.turn_rate_radps) <= 1.57
    assert abs(control.acceleration_mps2) <= 3.0
    assert abs(control.turn_rate_radps - previous.turn_rate_radps) <= 0.05 + 1e-12
    assert abs(control.acceleration_mps2 - previous.acceleration_mps2) <= 0.7 + 1e-12
    assert abs(speed + STEP_S * control.acceleration_mps2) <= 4.5


@pytest.mark.parametrize(
    ("plan", "previous", "speed_mps", "expected"),
    [
        # Within the limits, a plan is driven as it is, one step of it.
        ([(0.03, -0.5), (0.05, 0.1), (0.1, 0.3)], STANDSTILL, 1.0, (0.03, -0.5)),
        # A speed that was observed with noise is left as fast as can be reached.
        ([(0.0, 0.0)], STANDSTILL, 4.8, (0.0, -0.7)),
        # The tolerance of a solver leads no rounding error beyond the speed limit.
        ([(0.0, 0.5 + 1e-7)], Input(0.0, 1.0), 4.45, (0.0, 0.5)),
        ([(0.0, -0.5 - 1e-7)], Input(0.0, -1.0), -4.45, (0.0, -0.5)),
        # From −0.7 m/s² no more than 0; and to 4.5 m/s no more than 0.15 m/s are left.
        ([(0.4, 2.0)], Input(0.05, -0.7), 0.93, (0.1, 0.0)),
        ([(0.4, 2.0)], Input(0.4, 1.5), 4.35, (0.4, 1.5)),
    ],
)
def test_what_cannot_be_driven_is_brought_to_what_can(plan, previous, speed_mps, expected):
    found = driven(*plan, previous=previous, speed_mps=speed_mps)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("speed_mps", "previous", "expected"),
    [
        (0.0, Input(0.0, 0.0), (-0.05, -0.7)),
        (-0.1, Input(0.0, 0.0), (0.05, 0.7)),
        (2.0, Input(0.3, -1.0), (0.25, -1.7)),
        (-2.0, Input(0.3, -1.0), (0.35, -0.3)),
        (2.0, Input(-1.56, -2.9), (-1.57, -3.0)),
        (-2.0, Input(1.56, 2.9), (1.57, 3.0)),
    ],
)
def test_without_a_plan_the_publications_rule_decides(speed_mps, previous, expected):
    """Going forward or standing the lowest reachable inputs, in reverse the highest."""
    assert failure_input(Limits(), previous, speed_mps, STEP_S) == pytest.approx(expected)
