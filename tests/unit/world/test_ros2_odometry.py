"""From odometry to a state in the frame of the area, and from its stamps to when it was measured."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros2_helpers import diagonal, odometry_bytes, settings

from protocol.messages import Accuracy
from protocol.vehicle import wrap_angle
from world.ros2.cdr import decode_odometry
from world.ros2.odometry import WINDOW_S, OdometryError, Stamps, reading_of

places = st.floats(-1e4, 1e4)
angles = st.floats(-3.1, 3.1)


def read(*values, robot=None, **fields):
    odometry = decode_odometry(odometry_bytes(*values, **fields))
    return reading_of(odometry, settings(1, robot=robot).robots[0])


@given(x_m=places, y_m=places, heading_rad=angles, turned=angles, off_x_m=places, off_y_m=places)
def test_an_origin_moves_and_turns(x_m, y_m, heading_rad, turned, off_x_m, off_y_m):
    origin = {"x_m": off_x_m, "y_m": off_y_m, "heading_rad": turned}
    frame = {"origin": origin, "frame_id": "map"}
    reading = read(x_m, y_m, heading_rad, 1.5, 0.25, stamp_ns=7, frame_id="map", robot=frame)
    assert (reading.turn_rate_radps, reading.stamp_ns) == (0.25, 7)
    found = reading.state
    moved = complex(off_x_m, off_y_m) + complex(x_m, y_m) * complex(math.cos(turned), math.sin(turned))
    assert (found.x_m, found.y_m) == pytest.approx((moved.real, moved.imag), abs=1e-6)
    assert wrap_angle(found.heading_rad - heading_rad - turned) == pytest.approx(0.0, abs=1e-9)
    assert found.speed_mps == 1.5


@given(st.tuples(angles, st.floats(-1.4, 1.4), angles))
def test_the_heading_is_the_rotation_about_z_of_a_tilted_robot_too(angles_rad):
    yaw, pitch, roll = angles_rad
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(a / 2), math.sin(a / 2)) for a in (yaw, pitch, roll))
    quaternion = (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
    for scale in (1.0, -1.0, 1.005):  # both signs mean the same rotation; a norm may be rounded
        found = read(orientation=tuple(scale * part for part in quaternion)).state.heading_rad
        assert wrap_angle(found - yaw) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("fields", "reason", "detail"),
    [
        ({"orientation": (0.0, 0.0, math.nan, 1.0)}, "not finite", "not a finite number"),
        ({"orientation": (0.0, 0.0, 1.0, 1.0)}, "no rotation", "norm 1.41421 found"),
        ({"x_m": 2e5}, "out of range", "200000"),
        ({"turn_rate_radps": -1e9}, "out of range", "-1e+09 rad/s"),
        ({"frame_id": "map"}, "in another frame", "'map' found, 'odom' expected"),
    ],
)
def test_what_cannot_be_used_is_refused_with_a_reason(fields, reason, detail):
    with pytest.raises(OdometryError) as refused:
        read(**fields)
    assert refused.value.reason == reason
    assert detail in str(refused.value)


def test_the_covariance_gives_the_accuracy_and_the_worse_of_two_axes_counts():
    found = read(
        pose_covariance=diagonal(x=0.01, y=0.04, z=9.0, yaw=0.0025),
        twist_covariance=diagonal(x=0.09, y=4.0),
    )
    assert found.accuracy.as_tuple() == pytest.approx((0.2, 0.2, 0.05, 0.3))
    for variance in (0.0, -1.0, math.nan, math.inf, 1e6):  # these say nothing
        nothing = diagonal(x=variance, y=variance, yaw=variance)
        assert read(pose_covariance=nothing, twist_covariance=nothing).accuracy == Accuracy()


SILENCE_S = 0.3


def measured(stamps, stamp_s, arrived_s):
    return stamps.measured_s(round(stamp_s * 1e9), arrived_s, SILENCE_S)


@given(off_s=st.floats(-1e9, 1e9), delays_s=st.lists(st.floats(0.0, 0.2), min_size=1, max_size=50))
def test_what_took_longer_than_the_quickest_is_older_by_so_much(off_s, delays_s):
    stamps, least_s = Stamps(), 1.0
    for index, delay_s in enumerate(delays_s):
        made_s, least_s = 100.0 + 0.5 * index, min(least_s, delay_s)
        if 0.5 * index + delay_s > WINDOW_S:
            break
        found = measured(stamps, made_s + off_s, made_s + delay_s)
        assert found == pytest.approx(made_s + least_s, abs=1e-6)


def test_no_older_stamp_is_taken_but_a_clock_that_was_set_back_is_believed_after_a_silence():
    stamps = Stamps()
    assert measured(stamps, 1000.0, 1.0) == pytest.approx(1.0)
    assert measured(stamps, 1000.0, 1.1) is None
    assert measured(stamps, 10.0, 1.2) is None
    assert measured(stamps, 10.2, 1.4) == pytest.approx(1.4)
    assert measured(stamps, 10.3, 1.5) == pytest.approx(1.5)
    assert measured(stamps, 2000.0, 1.6) == pytest.approx(1.6), "and one that was set forward at once"


def test_what_waited_for_a_link_to_come_back_is_as_old_as_it_is():
    stamps = Stamps()
    for index in range(10):
        measured(stamps, 500.0 + 0.1 * index, 0.1 * index)
    back_s = 4.0  # the link was away since 0.9 s
    for index in range(10, 40):
        assert measured(stamps, 500.0 + 0.1 * index, back_s) == pytest.approx(0.1 * index)
