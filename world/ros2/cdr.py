"""Two ROS 2 messages as bytes: ``nav_msgs/msg/Odometry`` in, ``geometry_msgs/msg/Twist`` out.

The format is plain CDR (XCDR version 1): four bytes that say the byte order, then the fields in their order,
each number aligned to its size, counted from after those four. Both messages end in a fixed row of doubles,
so there is little to parse, and every byte is accounted for.
"""

import struct
from typing import NamedTuple

MAX_FRAME_BYTES = 256
"""Of a frame's name; no payload is longer than two of these and its numbers."""

_BYTE_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
"""By the first two bytes, which also say that it is plain CDR; the other two mean nothing here."""
_HEADER_BYTES = 4
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_NUMBERS = 3 + 4 + 36 + 3 + 3 + 36
"""Position, orientation, covariance; linear and angular velocity, covariance."""


class CdrError(Exception):
    """Bytes that are not the message they should be; the text says what is wrong."""


class Odometry(NamedTuple):
    """``nav_msgs/msg/Odometry``: a pose in `frame_id` and a twist in `child_frame_id`.

    Covariances are the rows of 6×6 matrices over x, y, z and the rotations about x, y, z.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    position: tuple[float, ...]
    """x, y, z in m."""
    orientation: tuple[float, ...]
    """The quaternion x, y, z, w."""
    pose_covariance: tuple[float, ...]
    linear: tuple[float, ...]
    """x, y, z in m/s."""
    angular: tuple[float, ...]
    """About x, y, z in rad/s."""
    twist_covariance: tuple[float, ...]


class Twist(NamedTuple):
    """``geometry_msgs/msg/Twist`` of a vehicle that drives forward and turns; the rest of it is zero."""

    speed_mps: float
    turn_rate_radps: float


STOP = Twist(0.0, 0.0)


def encode_twist(twist: Twist) -> bytes:
    """The bytes of a twist, in little endian."""
    linear, angular = (twist.speed_mps, 0.0, 0.0), (0.0, 0.0, twist.turn_rate_radps)
    return _LITTLE_ENDIAN + struct.pack("<6d", *linear, *angular)


def decode_odometry(payload: bytes) -> Odometry:
    """Odometry from its bytes, in either byte order.

    Raises:
        CdrError: they are something else, too short or too long.
    """
    if len(payload) < _HEADER_BYTES:
        raise CdrError(f"{len(payload)} bytes are less than the header of CDR")
    order = _BYTE_ORDERS.get(payload[:2])
    if order is None:
        raise CdrError(f"the header {payload[:4].hex()} is not that of plain CDR, 0000… or 0001…")
    body = payload[_HEADER_BYTES:]
    try:
        second, nanosecond = struct.unpack_from(f"{order}iI", body)
        frame_id, end = _text(order, body, 8)
        child_frame_id, end = _text(order, body, end)
        start = _aligned(end, 8)
        numbers = struct.unpack_from(f"{order}{_NUMBERS}d", body, start)
    except struct.error:
        raise CdrError(f"{len(payload)} bytes are too few for an Odometry") from None
    if len(body) != start + 8 * _NUMBERS:
        raise CdrError(f"{len(body) - start - 8 * _NUMBERS} bytes are left after an Odometry")
    return Odometry(
        stamp_ns=second * 1_000_000_000 + nanosecond,
        frame_id=frame_id,
        child_frame_id=child_frame_id,
        position=numbers[:3],
        orientation=numbers[3:7],
        pose_covariance=numbers[7:43],
        linear=numbers[43:46],
        angular=numbers[46:49],
        twist_covariance=numbers[49:],
    )


def _text(order: str, body: bytes, offset: int) -> tuple[str, int]:
    """A text that begins with its length at the next multiple of four, and where it ends."""
    start = _aligned(offset, 4) + 4
    [length] = struct.unpack_from(f"{order}I", body, start - 4)
    end = start + length
    if not 0 < length <= MAX_FRAME_BYTES or end > len(body):
        raise CdrError(f"the name of a frame cannot have {length} bytes here")
    if body[end - 1]:
        raise CdrError("the name of a frame does not end in a zero")
    try:
        return body[start : end - 1].decode(), end
    except UnicodeDecodeError:
        raise CdrError("the name of a frame is not UTF-8") from None


def _aligned(offset: int, size: int) -> int:
    return -(-offset // size) * size
