"""What a vehicle's limits allow at the next step, how it comes to a standstill, and when it has arrived."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.vehicle import (
    Input,
    Limits,
    braking_input,
    has_arrived,
    nearest_turn,
    reachable_inputs,
    wrap_angle,
)

ROUNDING = 1e-9
STEPS_S = st.sampled_from([0.02, 0.1, 0.25])


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


LIMITS = st.just(Limits()) | st.builds(
    Limits,
    speed_mps=numbers(0.1, 6),
    acceleration_mps2=numbers(0.2, 6),
    turn_rate_radps=numbers(0.1, 4),
    jerk_mps3=numbers(0.5, 60),
    turn_acceleration_radps2=numbers(0.1, 20),
)


@st.composite
def driving(draw: st.DrawFn) -> tuple[Limits, Input, float]:
    """Limits, a previous input and a speed within them."""
    limits = draw(LIMITS)
    turn_rate = draw(numbers(-1, 1)) * limits.turn_rate_radps
    acceleration = draw(numbers(-1, 1)) * limits.acceleration_mps2
    return limits, Input(turn_rate, acceleration), draw(numbers(-1, 1)) * limits.speed_mps


@given(LIMITS, *[st.builds(Input, numbers(-9, 9), numbers(-9, 9))] * 2, STEPS_S)
def test_reachable_inputs_are_a_box_around_the_previous_input_within_limits_and_rates(
    limits: Limits, previous: Input, wanted: Input, step_s: float
) -> None:
    """A previous input beyond the limits is brought back inside first; clipping gives the nearest one."""
    reachable = reachable_inputs(limits, previous, step_s)
    bounds = (limits.turn_rate_radps, limits.acceleration_mps2)
    rates = (limits.turn_acceleration_radps2, limits.jerk_mps3)
    held = Input(*(min(max(value, -bound), bound) for value, bound in zip(previous, bounds, strict=True)))
    for low, at, high, bound, rate in zip(reachable[0], held, reachable[1], bounds, rates, strict=True):
        assert low <= at <= high
        assert low == -bound or low == pytest.approx(at - rate * step_s)
        assert high == bound or high == pytest.approx(at + rate * step_s)
        assert -bound <= low
        assert high <= bound
    for got, want, low, high in zip(reachable.clip(wanted), wanted, *reachable, strict=True):
        assert got == (low if want < low else high if want > high else want)


def brake(limits: Limits, previous: Input, speed_mps: float, step_s: float) -> list[tuple[Input, float]]:
    """Inputs and speeds of the closed loop from the given start until nothing moves any more."""
    course = [(previous, speed_mps)]
    longest = 10 + 5 * _time_optimal_stop_s(limits, previous, speed_mps) / step_s
    while abs(speed_mps) > ROUNDING or abs(previous.acceleration_mps2) > ROUNDING:
        assert len(course) < longest, "no standstill"
        previous = braking_input(limits, previous, speed_mps, step_s)
        speed_mps += step_s * previous.acceleration_mps2
        course.append((previous, speed_mps))
    return course


def _time_optimal_stop_s(limits: Limits, previous: Input, speed_mps: float) -> float:
    """Shortest time to v = 0 and a = 0 in continuous time under a jerk and an acceleration limit.

    The known profile: maximum jerk to a peak acceleration, hold it if it is the limit, maximum jerk back.
    """
    jerk, limit, now = limits.jerk_mps3, limits.acceleration_mps2, previous.acceleration_mps2
    left = speed_mps + now * abs(now) / (2 * jerk)  # speed after bringing the acceleration straight to zero
    sign = -math.copysign(1, left)
    now, change = sign * now, -sign * speed_mps
    peak = math.sqrt(max(0.0, jerk * change + now**2 / 2))
    if peak <= limit:
        return (2 * peak - now) / jerk
    return (2 * limit - now) / jerk + (change - (2 * limit**2 - now**2) / (2 * jerk)) / limit


def _speed_when_releasing(limits: Limits, previous: Input, speed_mps: float, step_s: float) -> float:
    """The speed that remains when every step takes as much off the acceleration as the jerk limit allows."""
    size = abs(previous.acceleration_mps2)
    while size > 0:
        size = max(0.0, size - limits.jerk_mps3 * step_s)
        speed_mps += math.copysign(size, previous.acceleration_mps2) * step_s
    return speed_mps


@given(driving(), STEPS_S)
def test_braking_ends_at_rest_soon_within_all_limits_and_without_overshooting(
    start: tuple[Limits, Input, float], step_s: float
) -> None:
    """Whoever still decelerates hard when almost standing rolls back, whatever the next inputs are."""
    limits, first, speed = start
    course = brake(*start, step_s)
    assert len(course) - 1 <= _time_optimal_stop_s(*start) / step_s + 3
    unavoidable = _speed_when_releasing(*start, step_s)
    lowest, highest = min(0.0, speed, unavoidable), max(0.0, speed, unavoidable)
    for (before, _), (after, reached) in pairwise(course):
        assert abs(after.turn_rate_radps) <= limits.turn_rate_radps
        assert abs(after.acceleration_mps2) <= limits.acceleration_mps2
        change = limits.jerk_mps3 * step_s + ROUNDING
        assert abs(after.acceleration_mps2 - before.acceleration_mps2) <= change
        assert lowest - ROUNDING <= reached <= highest + ROUNDING
        # The turn rate goes to zero as fast as it can.
        slower = max(0.0, abs(before.turn_rate_radps) - limits.turn_acceleration_radps2 * step_s)
        assert abs(after.turn_rate_radps) == pytest.approx(slower, abs=ROUNDING)
        assert after.turn_rate_radps * first.turn_rate_radps >= 0


ANGLES = st.floats(-100, 100)
GOAL = (4.0, -4.0, 3.0, 0.0)


@given(ANGLES, ANGLES)
def test_the_nearest_turn_keeps_the_direction_and_lies_within_half_a_turn_of_the_reference(
    angle: float, reference: float
) -> None:
    for turned, middle in ((nearest_turn(angle, reference), reference), (wrap_angle(angle), 0.0)):
        assert abs(turned - middle) <= math.pi + 1e-9
        assert math.cos(turned - angle) == pytest.approx(1.0)


@given(st.tuples(*[st.floats(-0.2, 0.2)] * 4), st.integers(-20, 20))
def test_arrival_is_the_norm_of_all_errors_but_whole_turns(errors: tuple[float, ...], turns: int) -> None:
    x_m, y_m, heading_rad, speed_mps = (at + error for at, error in zip(GOAL, errors, strict=True))
    state = (x_m, y_m, heading_rad + turns * math.tau, speed_mps)
    distance = math.hypot(*errors)
    assert has_arrived(state, GOAL, distance * (1.0 + 1e-9) + 1e-9)
    assert not has_arrived(state, GOAL, distance * (1.0 - 1e-9) - 1e-9)
