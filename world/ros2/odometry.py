"""The robots of a bridge: what its file says of them, and what odometry says, in the frame of the area."""

import math
import re
from collections import deque
from itertools import combinations
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import AfterValidator, Field, model_validator

from chassis.files import Record, mistake_at
from protocol.keys import Id
from protocol.messages import Accuracy
from protocol.scene import MAX_ROBOTS, Metres, NonNegative, PublicRobot, Rules, Scene
from world.ros2.cdr import Odometry
from world.vehicle import VehicleState

WINDOW_S = 10.0
"""For so long the quickest message counts: in this time clocks do not drift apart by a millisecond."""
NORM_TOLERANCE = 0.01
"""By which the norm of a quaternion may differ from one: rounding, not another meaning."""
FURTHEST_M = 1e5
FASTEST = 1e3
"""In m/s and rad/s. Within these, a robot stays in the range of messages while it is taken to go on."""

LARGEST_VARIANCE = 1e4
"""In m² and so on; some say 1e6 or more where they mean that they do not know."""
_FULL_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


def _is_full_name(text: str) -> str:
    if not _FULL_NAME.fullmatch(text):
        raise ValueError(
            f"{text!r} found, the full name of a ROS topic is expected: a / before each part, "
            "which is of letters, digits and _, no digit first, such as /robot_1/odom"
        )
    return text


Topic = Annotated[str, Field(max_length=256), AfterValidator(_is_full_name)]
"""A full ROS name, as it is called outside the robot: with the namespace that its Zenoh bridge adds."""
Wait = Annotated[float, Field(gt=0, le=10)]


class Origin(Record):
    """Where the frame of a robot's odometry lies in the frame of the area."""

    x_m: Metres = 0.0
    y_m: Metres = 0.0
    heading_rad: Metres = 0.0


class Ros2Robot(PublicRobot):
    """One robot: its id, its body and limits, its topics and its frame."""

    id: Id
    odometry: Topic
    command: Topic
    frame_id: Annotated[str, Field(min_length=1, max_length=255)] = "odom"
    """In which its odometry gives poses; odometry in another frame is refused."""
    origin: Origin = Origin()


class Unstated(Record):
    """Standard deviations of odometry whose covariance states none: level ``low`` of ``--noise``."""

    position_m: NonNegative = 0.02
    heading_rad: NonNegative = 0.035
    speed_mps: NonNegative = 0.05


class Ros2Bridge(Rules):
    """What a file for ``unspoken bridge ros2`` says."""

    connect: Annotated[str, Field(min_length=1, max_length=256)] = "tcp/127.0.0.1:7447"
    """Zenoh endpoint of the side of ROS."""
    stale_s: Wait = 0.3
    """Age of odometry beyond which nobody knows where the robot is."""
    drive_lag_s: Wait = 0.3
    """How far ahead of the measured speed the commanded one may run, in time at the limit of acceleration."""
    unstated_accuracy: Unstated = Unstated()
    robots: Annotated[list[Ros2Robot], Field(min_length=1, max_length=MAX_ROBOTS)]

    def scene(self) -> Scene:
        """What everybody may know."""
        rules = {name: getattr(self, name) for name in Rules.model_fields}
        robots = {r.id: PublicRobot(radius_m=r.radius_m, limits=r.limits) for r in self.robots}
        return Scene(**rules, robots=robots)

    @model_validator(mode="after")
    def _robots_differ(self) -> Self:
        for (_, one), (index, other) in combinations(enumerate(self.robots), 2):
            if one.id == other.id:
                raise mistake_at(f"robots.{index}.id", f"the id {one.id!r} is used twice; ids must differ")
        used: dict[str, str] = {}
        for index, robot in enumerate(self.robots):
            for field, topic in (("odometry", robot.odometry), ("command", robot.command)):
                if topic in used:
                    raise mistake_at(
                        f"robots.{index}.{field}",
                        f"the topic {topic} is that of {used[topic]}, too; every robot needs its own",
                    )
                used[topic] = f"robot {robot.id!r} ({field})"
        return self


class Stamps:
    """The stamps of one robot's odometry.

    Its clock may be any time off. The quickest message of the last ``WINDOW_S`` is taken to have come at
    once, and what took longer is older by so much. So a message that was held up on its way, or waited with
    others for a link to come back, is as old as it really is, whatever the robot's clock says; but for the
    time that even the quickest one took.
    """

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._arrived_s = 0.0
        self._offsets: deque[tuple[float, float]] = deque()  # arrivals, offsets: both ascend

    def measured_s(self, stamp_ns: int, arrived_s: float, silence_s: float) -> float | None:
        """When a message was measured, on the clock of the arrivals.

        Args:
            stamp_ns: on the robot's clock.
            arrived_s: when it came.
            silence_s: after so long without a newer one, an older stamp means that the robot's clock has
                been set back, and is believed.

        Returns:
            None for a message that is not newer than the last one.
        """
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            if arrived_s - self._arrived_s <= silence_s:
                return None
            self._offsets.clear()
        self._last_ns, self._arrived_s = stamp_ns, arrived_s
        stamp_s = stamp_ns / 1e9
        self._keep(arrived_s, arrived_s - stamp_s)
        return stamp_s + self._offsets[0][1]

    def _keep(self, arrived_s: float, offset_s: float) -> None:
        """Leave only what may still be the least offset; the first one is."""
        while self._offsets and self._offsets[-1][1] >= offset_s:
            self._offsets.pop()
        self._offsets.append((arrived_s, offset_s))
        while self._offsets[0][0] < arrived_s - WINDOW_S:
            self._offsets.popleft()


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
