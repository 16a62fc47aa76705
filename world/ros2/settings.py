"""What the file of a bridge to ROS 2 says: the public scene of its robots, and where each is found."""

import re
from itertools import combinations
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from chassis.files import Record
from chassis.yaml_file import mistake_at
from protocol.keys import Id
from protocol.messages import Accuracy
from protocol.scene import MAX_ROBOTS, Metres, NonNegative, PublicRobot, Rules, Scene

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

    def accuracy(self) -> Accuracy:
        """The same as observations tell it."""
        return Accuracy(**self.model_dump())


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
        return self

    @model_validator(mode="after")
    def _topics_differ(self) -> Self:
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
