"""The side of ROS: odometry comes in, twists go out, over the keys of Zenoh's bridge for ROS 2."""

import time
from collections.abc import Callable
from functools import partial
from queue import Empty, SimpleQueue

import zenoh
from structlog.typing import FilteringBoundLogger

from protocol.session import client_session, open_in_background
from protocol.vital_signs import BEAT_S
from world.ros2.cdr import Twist, encode_twist
from world.ros2.inbox import OdometryInbox
from world.ros2.settings import Ros2Bridge

PATIENCE_S = 10.0
"""After this time without a router, and every so often, its absence is told."""

Opened = SimpleQueue[zenoh.Session | zenoh.ZError | None]
"""What the opening of the session came to; None: it is not wanted any more."""


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


def open_client(
    connect: str, opened: Opened, log: FilteringBoundLogger, beat: Callable[[], object]
) -> zenoh.Session | None:
    """A session of the router on the side of ROS, which is waited for.

    Args:
        connect: its endpoint.
        opened: None in it ends the waiting.
        log: for people.
        beat: called at least every ``BEAT_S`` while it waits.

    Returns:
        None if it is not wanted any more.

    Raises:
        zenoh.ZError: Zenoh cannot use this endpoint.
    """
    open_in_background(client_session(connect), opened.put)
    told_s = time.monotonic()
    while True:
        beat()
        try:
            found = opened.get(timeout=BEAT_S)
        except Empty:
            if time.monotonic() - told_s < PATIENCE_S:
                continue
            told_s += PATIENCE_S
            log.warning("still waiting: there is no Zenoh router of ROS at this endpoint", connect=connect)
            continue
        if isinstance(found, zenoh.ZError):
            raise found
        return found
