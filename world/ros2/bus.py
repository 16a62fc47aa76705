"""The side of ROS: odometry comes in, twists go out, over the keys of Zenoh's bridge for ROS 2."""

from functools import partial

import zenoh

from world.ros2.cdr import Twist, encode_twist
from world.ros2.inbox import OdometryInbox
from world.ros2.settings import Ros2Bridge


def key_of(topic: str) -> str:
    """The Zenoh key of a ROS topic: its full name without the first slash."""
    return topic.removeprefix("/")


class Ros:
    """Everything that is declared on the session to the side of ROS.

    Args:
        session: open for as long as this is used.
        settings: which robots, on which topics.
        inbox: where odometry goes.
    """

    def __init__(self, session: zenoh.Session, settings: Ros2Bridge, inbox: OdometryInbox) -> None:
        def store(robot: str, sample: zenoh.Sample) -> None:
            inbox.store(robot, sample.payload.to_bytes())

        self._twists = {
            robot.id: session.declare_publisher(
                key_of(robot.command),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.REAL_TIME,
                express=True,
            )
            for robot in settings.robots
        }
        self._declared = [
            session.declare_subscriber(key_of(robot.odometry), partial(store, robot.id))
            for robot in settings.robots
        ]

    def put(self, robot: str, twist: Twist) -> None:
        """Tell a robot what to do; what does not get through is made up for by the next one."""
        self._twists[robot].put(encode_twist(twist))
