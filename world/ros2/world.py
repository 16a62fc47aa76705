"""Real robots as a pure core: odometry and commands in, observations and twists out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from protocol.messages import Accuracy, Command, Observation, State
from protocol.vehicle import Limits
from world.referee import Distances
from world.ros2.cdr import STOP, Odometry, Twist
from world.ros2.odometry import OdometryError, Reading, Ros2Bridge, Ros2Robot, Stamps, reading_of
from world.vehicle import Vehicle, VehicleState
from world.world import BaseWorld

FIRST_STEP = 1
"""Robots take everybody to stand at step 0. Nobody has made sure of that here, so there is none."""


@dataclass
class _Robot:
    settings: Ros2Robot
    vehicle: Vehicle
    """Where the robot is at the present step, with the speed that is wanted of it then."""
    stamps: Stamps = field(default_factory=Stamps)
    reading: Reading | None = None
    measured_s: float = -math.inf
    seen: VehicleState | None = None
    """Where it is at the present step as odometry says; None: nobody knows."""
    accuracy: Accuracy = field(default_factory=Accuracy)


class OdometryWorld(BaseWorld):
    """All robots of a bridge, one step after the other.

    Every step begins with `look`. A robot is in the scene while its odometry is no older than ``stale_s``:
    only then it is seen, is told what it sees, and drives. All others are told to stand. By itself the run
    never ends and nobody arrives, since nobody here knows a goal.

    A twist holds the speed at the end of the step, and the turn rate. It is integrated from the commanded
    speed rather than from the measured one, which lags behind it; yet it runs ahead of that by no more than
    ``drive_lag_s`` of acceleration, so that a robot that was held back does not start with a jump.
    """

    def __init__(self, settings: Ros2Bridge, *, epoch: int) -> None:
        nowhere = VehicleState(0.0, 0.0, 0.0, 0.0)
        vehicles = {robot.id: Vehicle(robot.limits, settings.step_s, nowhere) for robot in settings.robots}
        super().__init__(settings, vehicles, Distances(settings.scene()), epoch=epoch, step=FIRST_STEP)
        self._settings = settings
        self._tracked = {robot.id: _Robot(robot, vehicles[robot.id]) for robot in settings.robots}

    def take(self, robot: str, odometry: Odometry, arrived_s: float) -> None:
        """Odometry has come; it counts from the next `look` on.

        Raises:
            OdometryError: it cannot be used, or is not newer than what was there before.
        """
        known = self._tracked[robot]
        reading = reading_of(odometry, known.settings)
        measured_s = known.stamps.measured_s(reading.stamp_ns, arrived_s, self._settings.stale_s)
        if measured_s is None:
            raise OdometryError("not newer than the last one", f"stamp {reading.stamp_ns / 1e9:.9f} s")
        known.reading, known.measured_s = reading, measured_s

    def look(self, now_s: float) -> None:
        """The present step is now: everybody is where odometry says, brought to this moment."""
        for robot in self._tracked.values():
            age_s = max(now_s - robot.measured_s, 0.0)
            if robot.reading is None or age_s > self._settings.stale_s:
                robot.seen = None
                robot.vehicle.stand()
            else:
                seen = gone_on(robot.reading, age_s)
                robot.vehicle.state = seen._replace(speed_mps=self._wanted_mps(robot, seen.speed_mps))
                robot.accuracy = self._accuracy(robot.reading, robot.settings.limits, age_s)
                robot.seen = seen
        self._distances.measure(self._states())

    def observations(self) -> Mapping[str, Observation]:
        """What each robot in the scene is told of the present step: all that are, itself included."""
        states = {robot: State.of(*state) for robot, state in self._states().items()}
        observation = self._observation(states, _worst([self._tracked[robot].accuracy for robot in states]))
        return dict.fromkeys(states, observation)

    def twist(self, robot: str, command: Command | None = None) -> Twist:
        """What this robot is to do during the present step."""
        known = self._tracked[robot]
        if known.seen is None:
            return STOP
        driven = known.vehicle.driven_by(self._answer(robot, command))
        return Twist(driven.state.speed_mps, driven.applied.turn_rate_radps)

    def _states(self) -> Mapping[str, VehicleState]:
        return {name: robot.seen for name, robot in self._tracked.items() if robot.seen}

    def _wanted_mps(self, robot: _Robot, measured_mps: float) -> float:
        """The speed that a robot is to have by now: its own, where nothing was wanted of it before."""
        if robot.seen is None:
            return measured_mps
        ahead_mps = robot.settings.limits.acceleration_mps2 * self._settings.drive_lag_s
        wanted_mps = robot.vehicle.state.speed_mps
        return min(max(wanted_mps, measured_mps - ahead_mps), measured_mps + ahead_mps)

    def _accuracy(self, reading: Reading, limits: Limits, age_s: float) -> Accuracy:
        """Of a state that is this old: of the sensors, and of what may have changed since."""
        stated, unstated = reading.accuracy, self._settings.unstated_accuracy
        sped_mps = limits.acceleration_mps2 * age_s / math.sqrt(3.0)
        turned_radps = limits.turn_acceleration_radps2 * age_s / math.sqrt(3.0)
        return Accuracy(
            position_m=math.hypot(stated.position_m or unstated.position_m, sped_mps * age_s / 2.0),
            heading_rad=math.hypot(stated.heading_rad or unstated.heading_rad, turned_radps * age_s / 2.0),
            speed_mps=math.hypot(stated.speed_mps or unstated.speed_mps, sped_mps),
        )


def gone_on(reading: Reading, age_s: float) -> VehicleState:
    """Where a robot is some time after it was seen, had it kept its speed and turn rate: on an arc."""
    state, half_rad = reading.state, reading.turn_rate_radps * age_s / 2.0
    chord_m = state.speed_mps * age_s * (math.sin(half_rad) / half_rad if half_rad else 1.0)
    return VehicleState(
        state.x_m + chord_m * math.cos(state.heading_rad + half_rad),
        state.y_m + chord_m * math.sin(state.heading_rad + half_rad),
        state.heading_rad + 2.0 * half_rad,
        state.speed_mps,
    )


def _worst(of_each: list[Accuracy]) -> Accuracy:
    """One accuracy for all: an observation tells but one, and nobody is to be seen better than he is."""
    return Accuracy(
        position_m=max((each.position_m for each in of_each), default=0.0),
        heading_rad=max((each.heading_rad for each in of_each), default=0.0),
        speed_mps=max((each.speed_mps for each in of_each), default=0.0),
    )
