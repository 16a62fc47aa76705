"""How the processes of a run are, gathered from what they say. No input or output, and no clock."""

from collections import defaultdict, deque
from typing import Final, Literal

import numpy as np

from chassis.files import Record
from protocol.messages import Command, Degradation, Message, Mind, PublicScene, Truth, Verdict

WINDOW_S: Final = 5.0
"""What rates and times are of."""
MOST: Final = 5000
"""Values kept of one kind, whatever a robot says in that time."""


class Spread(Record):
    """Of times in ms."""

    p50: float
    p99: float


class Recent:
    """Values of the last ``WINDOW_S``."""

    def __init__(self) -> None:
        self._values: deque[tuple[float, float]] = deque(maxlen=MOST)

    def add(self, at_s: float, value: float) -> None:
        """A value came at a time."""
        self._values.append((at_s, value))

    def rate_hz(self, now_s: float) -> float | None:
        """How often values come; None where fewer than two came."""
        self._forget(now_s)
        if len(self._values) < 2:
            return None
        return (len(self._values) - 1) / max(now_s - self._values[0][0], 1e-3)

    def spread(self, now_s: float) -> Spread | None:
        """Median and 99th percentile; None where no value came."""
        self._forget(now_s)
        if not self._values:
            return None
        p50, p99 = np.percentile([value for _, value in self._values], (50.0, 99.0)).tolist()
        return Spread(p50=p50, p99=p99)

    def _forget(self, now_s: float) -> None:
        while self._values and self._values[0][0] < now_s - WINDOW_S:
            self._values.popleft()


QUIET_S: Final = 3.0
"""Who says nothing for longer, although the run goes on, is quiet."""

WorldState = Literal["waits", "drives", "quiet", "ended"]
"""It waits for robots before step 0; steps come; they have ceased to come; there is a verdict."""
RobotState = Literal["missing", "present", "ready", "degraded", "arrived", "quiet", "lost"]
"""It was never there; it is there and has not decided yet; it decides; it does, but not as it should; it is
at its goal; it is there, but decides no more; it was there."""


class WorldStatus(Record):
    """Of the world."""

    state: WorldState
    step: int | None = None
    time_s: float | None = None
    rate_hz: float | None = None
    arrived: int = 0
    minimum_distance_m: float | None = None
    collisions: int = 0
    verdict: Verdict | None = None


class RobotStatus(Record):
    """Of one robot."""

    robot: str
    state: RobotState
    step: int | None
    """Of its last decision."""
    rate_hz: float | None
    decide_ms: Spread | None
    lag_ms: Spread | None
    """From the truth of a step to the command for it, as they come here."""
    degraded: tuple[Degradation, ...]
    solver_failures: int
    interventions: int
    missed: int
    refused: int


class Status(Record):
    """Of a run at a moment."""

    run: str
    world: WorldStatus
    robots: tuple[RobotStatus, ...]


class _Robot:
    def __init__(self) -> None:
        self.present = self.was_there = False
        self.mind: Mind | None = None
        self.decided_s = 0.0
        self.decide_ms = Recent()
        self.lag_ms = Recent()


class Standing:
    """Takes the valid messages of a run, as :class:`fleet.run.listening.Decoder` gives them."""

    def __init__(self, run: str) -> None:
        self._run = run
        self._robots: defaultdict[str, _Robot] = defaultdict(_Robot)
        self._epoch: int | None = None
        self._truth: Truth | None = None
        self._truth_s = 0.0
        self._steps = Recent()

    @property
    def verdict(self) -> Verdict | None:
        """Of the run, once it has one."""
        return None if self._truth is None else self._truth.verdict

    def stands(self, robot: str, *, present: bool) -> None:
        """A robot's token has come or gone."""
        self._robots[robot].present = present
        self._robots[robot].was_there |= present

    def take(self, message: Message, now_s: float) -> None:
        """A message has come at a time."""
        if message.epoch != self._epoch and isinstance(message, PublicScene | Truth):
            self._epoch, self._truth = message.epoch, None
            for robot in self._robots.values():
                robot.mind = None
        if isinstance(message, PublicScene):
            for name in message.scene.robots:
                self._robots[name]  # is known from now on
        elif isinstance(message, Truth):
            self._truth, self._truth_s = message, now_s
            self._steps.add(now_s, 0.0)
        elif isinstance(message, Mind):
            robot = self._robots[message.robot]
            robot.mind, robot.decided_s = message, now_s
            robot.decide_ms.add(now_s, message.timings_ms.decide)
        elif isinstance(message, Command) and self._truth is not None and message.step == self._truth.step:
            self._robots[message.robot].lag_ms.add(now_s, 1000.0 * (now_s - self._truth_s))

    def status(self, now_s: float) -> Status:
        """How everybody is at a time."""
        robots = tuple(self._of_robot(name, robot, now_s) for name, robot in self._robots.items())
        return Status(run=self._run, world=self._of_world(now_s), robots=robots)

    def _of_world(self, now_s: float) -> WorldStatus:
        truth = self._truth
        if truth is None:
            return WorldStatus(state="waits")
        state: WorldState = "drives" if now_s - self._truth_s <= QUIET_S else "quiet"
        return WorldStatus(
            state=state if truth.verdict is None else "ended",
            step=truth.step,
            time_s=truth.time_s,
            rate_hz=self._steps.rate_hz(now_s),
            arrived=sum(robot.arrived_s is not None for robot in truth.robots.values()),
            minimum_distance_m=truth.minimum_distance_m,
            collisions=len(truth.collisions),
            verdict=truth.verdict,
        )

    def _of_robot(self, name: str, robot: _Robot, now_s: float) -> RobotStatus:
        mind, truth = robot.mind, self._truth
        true = truth.robots.get(name) if truth else None
        return RobotStatus(
            robot=name,
            state=self._state(name, robot),
            step=mind.step if mind else None,
            rate_hz=robot.decide_ms.rate_hz(now_s),
            decide_ms=robot.decide_ms.spread(now_s),
            lag_ms=robot.lag_ms.spread(now_s),
            degraded=mind.degraded if mind else (),
            solver_failures=mind.solver_failures if mind else 0,
            interventions=mind.interventions if mind else 0,
            missed=true.deadline_misses if true else 0,
            refused=sum(truth.refused.get(name, {}).values()) if truth else 0,
        )

    def _state(self, name: str, robot: _Robot) -> RobotState:
        true = self._truth.robots.get(name) if self._truth else None
        if not robot.present:  # no step is published before all have been there
            return "lost" if robot.was_there or self._truth else "missing"
        if true is not None and true.arrived_s is not None:
            return "arrived"
        if robot.mind is None:
            return "present"
        if self._truth_s - robot.decided_s > QUIET_S:
            return "quiet"
        return "degraded" if robot.mind.degraded else "ready"
