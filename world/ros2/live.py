"""A world of real robots between two buses: odometry in from ROS, twists out, over ROS's Zenoh bridge."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import NamedTuple

import zenoh
from structlog.typing import FilteringBoundLogger

from protocol.messages import Command
from protocol.session import LATEST_WINS
from world.judge import RefusalNotices
from world.ros2.cdr import STOP, CdrError, Twist, decode_odometry, encode_twist
from world.ros2.odometry import OdometryError, Reason
from world.ros2.settings import Ros2Bridge
from world.ros2.world import OdometryWorld

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


class LiveWorld(OdometryWorld):
    """The core between two buses; a :class:`world.run.Steps`.

    At the beginning of each step every robot is told what to do should no command come, and as soon as its
    command comes, what that says: a robot whose agent hangs is already braking when that is noticed.

    Args:
        settings: see :class:`world.ros2.world.OdometryWorld`.
        inbox: odometry that comes in.
        drive: takes each robot's twists.
        log: for people.
        epoch: identifies this world in all its messages.
        now_s: the clock of the inbox.
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
        self._located: set[str] = set()

    @property
    def refused_odometry(self) -> dict[str, dict[Reason, int]]:
        """How much was not taken so far, by robot and reason."""
        return self._refusals.counts

    def begin(self) -> None:
        """The first step is now."""
        self._look_around()
        if lost := [robot for robot in self.robots if robot not in self._located]:
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
        self.look(self._now_s())
        located = set(self.present)
        for robot in self.robots:
            if robot in self._located - located:
                self._log.warning("odometry lost: the robot is stopped", robot=robot, step=self.step)
            elif robot in located - self._located:
                self._log.info("odometry found", robot=robot, step=self.step)
            self._drive(robot, self.twist(robot))
        self._located = located
