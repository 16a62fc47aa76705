"""A world of real robots between two buses: odometry in from ROS, twists out, over ROS's Zenoh bridge."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial

import zenoh
from structlog.typing import FilteringBoundLogger

from protocol.messages import Command
from protocol.session import LATEST_WINS
from world.judge import RefusalNotices
from world.ros2.cdr import STOP, CdrError, Twist, decode_odometry, encode_twist
from world.ros2.odometry import OdometryError, Reason, Ros2Bridge
from world.ros2.world import OdometryWorld

MOST_WAITING = 64
"""Of one robot. Of more than that in one step the oldest are not looked at."""


class OdometryInbox:
    """Stores on any thread, and does nothing else; is emptied on one."""

    def __init__(self, robots: Iterable[str], now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._waiting: dict[str, deque[tuple[str, bytes, float]]] = {
            robot: deque(maxlen=MOST_WAITING) for robot in robots
        }

    def store(self, robot: str, payload: bytes) -> None:
        """A payload has come on the odometry topic of one of the robots."""
        self._waiting[robot].append((robot, payload, self._now_s()))

    def take(self) -> list[tuple[str, bytes, float]]:
        """Robot, payload and time of arrival of what has come since the last time, of each robot in order."""
        return [waiting.popleft() for waiting in self._waiting.values() for _ in range(len(waiting))]


class Ros:
    """Everything that is declared on the session to the side of ROS.

    The Zenoh key of a ROS topic is its full name without the first slash.
    """

    def __init__(self, session: zenoh.Session, settings: Ros2Bridge, inbox: OdometryInbox) -> None:
        def store(robot: str, sample: zenoh.Sample) -> None:
            inbox.store(robot, sample.payload.to_bytes())

        self._twists = {
            robot.id: session.declare_publisher(robot.command.removeprefix("/"), express=True, **LATEST_WINS)
            for robot in settings.robots
        }
        self._declared = [
            session.declare_subscriber(robot.odometry.removeprefix("/"), partial(store, robot.id))
            for robot in settings.robots
        ]

    def put(self, robot: str, twist: Twist) -> None:
        """Tell a robot what to do; what does not get through is made up for by the next one."""
        self._twists[robot].put(encode_twist(twist))


class LiveWorld(OdometryWorld):
    """The core between two buses.

    At the beginning of each step every robot is told what to do should no command come, and as soon as its
    command comes, what that says: a robot whose agent hangs is already braking when that is noticed.
    """

    def __init__(
        self,
        settings: Ros2Bridge,
        inbox: OdometryInbox,
        drive: Callable[[str, Twist], None],
        log: FilteringBoundLogger,
        *,
        epoch: int,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(settings, epoch=epoch)
        self._inbox, self._drive, self._log, self._now_s = inbox, drive, log, now_s
        self._refusals = RefusalNotices[Reason](log, "odometry refused")

    @property
    def refused_odometry(self) -> dict[str, dict[Reason, int]]:
        """How much was not taken so far, by robot and reason."""
        return self._refusals.counts

    def begin(self) -> None:
        """The first step is now."""
        self._look_around()
        if lost := [robot for robot in self.robots if robot not in self.present]:
            self._log.warning("no odometry yet: not driven and not seen", robots=", ".join(lost))

    def heed(self, robot: str, command: Command) -> None:
        """A command of the present step has come and been taken."""
        self._drive(robot, self.twist(robot, command))

    def advance(self, commands: Mapping[str, Command]) -> None:
        """The next step is now."""
        super().advance(commands)
        self._look_around()

    def stop(self) -> None:
        """Tell every robot to stand."""
        for robot in self.robots:
            self._drive(robot, STOP)

    def _look_around(self) -> None:
        for robot, payload, arrived_s in self._inbox.take():
            try:
                self.take(robot, decode_odometry(payload), arrived_s)
            except CdrError as error:
                self._refusals.add(robot, "not an Odometry message", str(error))
            except OdometryError as error:
                self._refusals.add(robot, error.reason, str(error))
        before = self.present
        self.look(self._now_s())
        for robot in self.robots:
            if robot in before and robot not in self.present:
                self._log.warning("odometry lost: the robot is stopped", robot=robot, step=self.step)
            elif robot in self.present and robot not in before:
                self._log.info("odometry found", robot=robot, step=self.step)
            self._drive(robot, self.twist(robot))
