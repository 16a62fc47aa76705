"""The side of ROS: odometry comes in, twists go out, over the keys of Zenoh's bridge for ROS 2."""

import time
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import zenoh

from protocol.session import LATEST_WINS
from world.ros2.cdr import Twist, encode_twist
from world.ros2.settings import Ros2Bridge

MOST_WAITING = 64
"""Of one robot. Of more than that in one step the oldest are not looked at."""


class Arrival(NamedTuple):
    """A payload as received."""

    robot: str
    payload: bytes
    arrived_s: float


class OdometryInbox:
    """Stores on any thread, and does nothing else; is emptied on one.

    Args:
        robots: ids.
        now_s: a monotonic clock.
    """

    def __init__(self, robots: Iterable[str], now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._waiting: dict[str, deque[Arrival]] = {robot: deque(maxlen=MOST_WAITING) for robot in robots}

    def store(self, robot: str, payload: bytes) -> None:
        """A payload has come on the odometry topic of one of the robots."""
        self._waiting[robot].append(Arrival(robot, payload, self._now_s()))

    def take(self) -> list[Arrival]:
        """What has come since the last time, of each robot in its order."""
        return [waiting.popleft() for waiting in self._waiting.values() for _ in range(len(waiting))]


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
            robot.id: session.declare_publisher(key_of(robot.command), express=True, **LATEST_WINS)
            for robot in settings.robots
        }
        self._declared = [
            session.declare_subscriber(key_of(robot.odometry), partial(store, robot.id))
            for robot in settings.robots
        ]

    def put(self, robot: str, twist: Twist) -> None:
        """Tell a robot what to do; what does not get through is made up for by the next one."""
        self._twists[robot].put(encode_twist(twist))
