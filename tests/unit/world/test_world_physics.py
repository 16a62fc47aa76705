import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from world_helpers import command

from protocol.vehicle import STANDSTILL, Input, Limits, braking_input, stopping_time_s
from world.vehicle import Vehicle, VehicleState, drive

STEP_S = 0.1
FREE = Limits(jerk_mps3=1000.0, turn_acceleration_radps2=1000.0)


def roll(limits, state, wanted, steps, previous=STANDSTILL):
    states = [state]
    for _ in range(steps):
        state, previous, _ = drive(limits, state, previous, wanted, STEP_S)
        states.append(state)
    return states


def test_constant_acceleration_on_a_straight_line_follows_the_euler_sums():
    heading = 0.6
    states = roll(FREE, VehicleState(1.0, -2.0, heading, 0.0), Input(0.0, 1.5), 20)
    for n, state in enumerate(states):
        way = 1.5 * STEP_S**2 * n * (n - 1) / 2.0
        assert state.speed_mps == pytest.approx(1.5 * STEP_S * n, abs=1e-12)
        assert state.x_m == pytest.approx(1.0 + way * math.cos(heading), abs=1e-12)
        assert state.y_m == pytest.approx(-2.0 + way * math.sin(heading), abs=1e-12)


@pytest.mark.parametrize(("speed", "turn_rate"), [(2.0, 1.0), (2.0, -1.5), (-1.0, 0.7)])
def test_constant_speed_and_turn_rate_drive_a_regular_polygon(speed, turn_rate):
    states = roll(FREE, VehicleState(0.0, 0.0, 0.3, speed), Input(turn_rate, 0.0), 100)
    # Chords of length |v|·Δt that turn by ω·Δt lie on a circle of this radius (v/ω as Δt → 0); its centre
    # lies to the left of v·ω > 0, at a right angle to the direction halfway between two chords.
    signed = speed * STEP_S / (2.0 * math.sin(turn_rate * STEP_S / 2.0))
    across = 0.3 - turn_rate * STEP_S / 2.0
    centre = (-signed * math.sin(across), signed * math.cos(across))
    for step, state in enumerate(states):
        assert state.heading_rad == pytest.approx(0.3 + 0.1 * step * turn_rate)  # on through whole turns
        assert math.dist((state.x_m, state.y_m), centre) == pytest.approx(abs(signed), abs=1e-12)
    assert abs(signed) == pytest.approx(abs(speed / turn_rate), rel=2e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_speed_stays_at_its_limit_and_can_leave_it_at_once(sign):
    limits = Limits(speed_mps=1.0)
    top = VehicleState(0.0, 0.0, 0.0, sign * 0.95)
    state, applied, clipped = drive(limits, top, Input(0.0, sign * 1.0), Input(0.0, sign * 1.0), STEP_S)
    assert state.speed_mps == sign * 1.0
    assert applied.acceleration_mps2 == pytest.approx(sign * 0.5)
    assert clipped
    state, applied, clipped = drive(limits, state, applied, Input(0.0, sign * 0.5), STEP_S)
    assert (state.speed_mps, applied.acceleration_mps2, clipped) == (sign * 1.0, 0.0, True)
    state, applied, clipped = drive(limits, state, applied, Input(0.0, sign * -0.7), STEP_S)
    assert state.speed_mps == pytest.approx(sign * 0.93)
    assert not clipped


@pytest.mark.parametrize(
    ("wanted", "clipped"),
    [(Input(0.0, 0.7 + 5e-6), False), (Input(0.0, 0.7 + 5e-5), True), (Input(1.57, 3.0), True)],
)
def test_inputs_are_held_within_the_published_rates_beyond_which_a_rounding_error_is_no_violation(
    wanted, clipped
):
    _, applied, was_clipped = drive(Limits(), VehicleState(0, 0, 0, 0), STANDSTILL, wanted, STEP_S)
    assert applied == pytest.approx((min(wanted.turn_rate_radps, 0.05), 0.7), abs=1e-12)
    assert was_clipped == clipped


shares = st.floats(-1.0, 1.0)
LIMITS = st.builds(
    Limits,
    speed_mps=st.floats(0.5, 10.0),
    acceleration_mps2=st.floats(0.5, 5.0),
    turn_rate_radps=st.floats(0.2, 3.0),
    jerk_mps3=st.floats(1.0, 50.0),
    turn_acceleration_radps2=st.floats(0.5, 10.0),
)


@settings(max_examples=50)
@given(
    LIMITS,
    st.sampled_from([0.05, 0.1, 0.2]),
    st.tuples(shares, shares, shares, shares),
    st.lists(st.tuples(st.floats(-4.0, 4.0), st.floats(-6.0, 6.0)), max_size=5),
)
@example(Limits(), 0.1, (0.5, 1.0, 0.0, 1.0), [])  # at the top speed, and still speeding up
@example(Limits(), 0.1, (0.5, -1.0, 1.0, -1.0), [(4.0, -6.0)])
def test_a_vehicle_without_a_command_drives_exactly_the_contingency(limits, step_s, shares_before, told):
    """From the first step without one until it stands: braking, and nothing that was said before.

    Args:
        limits: of the vehicle.
        step_s: Δt.
        shares_before: heading, speed, turn rate and acceleration before, as shares of what is possible.
        told: inputs that are commanded before the first step without a command.
    """
    heading, speed, turn_rate, acceleration = shares_before
    state = VehicleState(3.0, -2.0, math.pi * heading, limits.speed_mps * speed)
    applied = Input(limits.turn_rate_radps * turn_rate, limits.acceleration_mps2 * acceleration)
    vehicle = Vehicle(limits, step_s, state, applied)
    for step, (turn_rate, acceleration) in enumerate(told):
        vehicle.obey(command("1", step, acceleration, turn_rate))
    (x_m, y_m, heading, speed), previous = vehicle.state, vehicle.applied
    clips = vehicle.clipped_commands
    undoing_s = limits.acceleration_mps2 / limits.jerk_mps3  # of the acceleration before
    straight_s = limits.turn_rate_radps / limits.turn_acceleration_radps2
    steps = math.ceil(max(stopping_time_s(limits) + undoing_s, straight_s) / step_s) + 3
    for missed in range(1, steps + 1):
        wanted = braking_input(limits, previous, speed, step_s)
        x_m += step_s * speed * math.cos(heading)
        y_m += step_s * speed * math.sin(heading)
        heading += step_s * wanted.turn_rate_radps
        before = speed
        speed = min(max(speed + step_s * wanted.acceleration_mps2, -limits.speed_mps), limits.speed_mps)
        vehicle.obey(None)
        assert vehicle.state == pytest.approx((x_m, y_m, heading, speed), abs=1e-9)
        assert vehicle.applied == pytest.approx((wanted.turn_rate_radps, (speed - before) / step_s), abs=1e-9)
        assert (vehicle.deadline_misses, vehicle.clipped_commands) == (missed, clips)
        previous = vehicle.applied
    assert vehicle.state.speed_mps == pytest.approx(0.0, abs=1e-6)
    assert vehicle.applied == pytest.approx((0.0, 0.0), abs=1e-6)
