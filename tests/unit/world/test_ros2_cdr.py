"""The two messages of ROS 2, compared with an independent library."""

import struct
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ros2_helpers import ODOMETRY, STORE, TWIST, odometry_bytes, twist_of

from world.ros2.cdr import CdrError, Twist, decode_odometry, encode_twist

numbers = st.floats(allow_nan=False, width=64)
triples, quadruples = st.tuples(*[numbers] * 3), st.tuples(*[numbers] * 4)
covariances = st.lists(numbers, min_size=36, max_size=36)
names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=40)


@settings(max_examples=50)
@given(
    position=triples,
    orientation=quadruples,
    linear=triples,
    angular=triples,
    pose_covariance=covariances,
    twist_covariance=covariances,
    stamp_ns=st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1),
    frame_id=names,
    child_frame_id=names,
    little_endian=st.booleans(),
)
def test_odometry_is_read_as_the_library_wrote_it(position, little_endian, **fields):
    x_m, y_m, z_m = position
    found = decode_odometry(odometry_bytes(x_m, y_m, z_m=z_m, little_endian=little_endian, **fields))
    assert found.position == position
    for name, value in fields.items():
        assert getattr(found, name) == (tuple(value) if isinstance(value, list) else value), name


@given(speed_mps=numbers, turn_rate_radps=numbers)
def test_a_twist_is_what_the_library_would_write_and_is_read_by_it(speed_mps, turn_rate_radps):
    payload = encode_twist(Twist(speed_mps, turn_rate_radps))
    assert twist_of(payload) == (speed_mps, turn_rate_radps)
    assert bytes(STORE.serialize_cdr(STORE.deserialize_cdr(payload, TWIST), TWIST)) == payload


@given(st.binary(max_size=900))
def test_any_bytes_are_odometry_or_one_kind_of_error(payload):
    for each in (payload, b"\0\0\0\0" + payload, b"\0\1\0\0" + payload):
        with suppress(CdrError):
            decode_odometry(each)


@given(st.booleans(), st.integers(0, 750), st.integers(0, 255))
def test_a_changed_byte_is_read_as_the_library_reads_it_or_refused(little_endian, place, byte):
    payload = bytearray(odometry_bytes(1.0, 2.0, 0.5, little_endian=little_endian))
    payload[place % len(payload)] = byte
    try:
        found = decode_odometry(bytes(payload))
    except CdrError:
        return
    read = STORE.deserialize_cdr(bytes(payload), ODOMETRY)
    assert found.frame_id == read.header.frame_id
    seen = (read.pose.pose.position.x, read.pose.pose.position.y)
    assert struct.pack("2d", *found.position[:2]) == struct.pack("2d", *seen)


def test_every_length_but_the_right_one_is_refused_and_every_other_encoding():
    whole = odometry_bytes(1.0, 2.0, 0.5)
    for length in (*range(80), len(whole) - 8, len(whole) - 1):
        with pytest.raises(CdrError):
            decode_odometry(whole[:length])
    for more in (b"\0", bytes(4), bytes(8)):
        with pytest.raises(CdrError, match="left after"):
            decode_odometry(whole + more)
    for header in ("0002", "0003", "000a", "0100"):
        with pytest.raises(CdrError, match=header):
            decode_odometry(bytes.fromhex(header) + whole[2:])
    assert decode_odometry(whole[:2] + b"\xab\xcd" + whole[4:]) == decode_odometry(whole), "mere options"
