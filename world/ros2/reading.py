"""What odometry says of a robot, in the terms and in the frame of the area; or why it says nothing."""

import math
from typing import Literal, NamedTuple

from protocol.messages import Accuracy
from world.physics import VehicleState
from world.ros2.cdr import Odometry
from world.ros2.settings import Ros2Robot

NORM_TOLERANCE = 0.01
"""By which the norm of a quaternion may differ from one: rounding, not another meaning."""
FURTHEST_M = 1e5
FASTEST = 1e3
"""In m/s and rad/s. Within these, a robot stays in the range of messages while it is taken to go on."""

LARGEST_VARIANCE = 1e4
"""In m² and so on; some say 1e6 or more where they mean that they do not know."""

Reason = Literal[
    "not an Odometry message",
    "in another frame",
    "not finite",
    "no rotation",
    "out of range",
    "not newer than the last one",
]
"""Why odometry is not taken."""


class OdometryError(Exception):
    """Odometry that is not taken; the text says more of what was found and expected."""

    def __init__(self, reason: Reason, detail: str) -> None:
        super().__init__(detail)
        self.reason: Reason = reason


class Reading(NamedTuple):
    """A robot as its odometry saw it."""

    stamp_ns: int
    """On the robot's own clock."""
    state: VehicleState
    turn_rate_radps: float
    accuracy: Accuracy
    """Zero where the covariance states nothing."""


def reading_of(odometry: Odometry, robot: Ros2Robot) -> Reading:
    """Bring odometry into the frame of the area.

    The heading is the rotation about z; the speed is the one forward, and what a robot moves sideways is
    left out.

    Args:
        odometry: as received.
        robot: whose it is.

    Raises:
        OdometryError: it cannot be used.
    """
    if odometry.frame_id != robot.frame_id:
        raise OdometryError(
            "in another frame", f"frame_id {odometry.frame_id!r:.80} found, {robot.frame_id!r} expected"
        )
    x_m, y_m, _ = odometry.position
    speed_mps, turn_rate_radps = odometry.linear[0], odometry.angular[2]
    if not all(map(math.isfinite, (x_m, y_m, *odometry.orientation, speed_mps, turn_rate_radps))):
        raise OdometryError("not finite", "a position, orientation or velocity is not a finite number")
    origin, heading_rad = robot.origin, _heading_rad(odometry.orientation)
    cosine, sine = math.cos(origin.heading_rad), math.sin(origin.heading_rad)
    state = VehicleState(
        origin.x_m + cosine * x_m - sine * y_m,
        origin.y_m + sine * x_m + cosine * y_m,
        math.remainder(origin.heading_rad + heading_rad, math.tau),
        speed_mps,
    )
    far, fast = max(abs(state.x_m), abs(state.y_m)), max(abs(speed_mps), abs(turn_rate_radps))
    if far > FURTHEST_M or fast > FASTEST:
        raise OdometryError(
            "out of range", f"({x_m:g}, {y_m:g}) m, {speed_mps:g} m/s, {turn_rate_radps:g} rad/s"
        )
    return Reading(odometry.stamp_ns, state, turn_rate_radps, _accuracy(odometry))


def _heading_rad(orientation: tuple[float, ...]) -> float:
    norm = math.hypot(*orientation)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise OdometryError("no rotation", f"a quaternion of norm {norm:g} found, 1 is expected")
    x, y, z, w = (part / norm for part in orientation)
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _accuracy(odometry: Odometry) -> Accuracy:
    pose, twist = odometry.pose_covariance, odometry.twist_covariance
    return Accuracy(
        position_m=_deviation(max(pose[0], pose[7])),
        heading_rad=_deviation(pose[35]),
        speed_mps=_deviation(twist[0]),
    )


def _deviation(variance: float) -> float:
    """The standard deviation; zero where the variance says nothing: not positive, not finite, too large."""
    return math.sqrt(variance) if 0.0 < variance <= LARGEST_VARIANCE else 0.0
