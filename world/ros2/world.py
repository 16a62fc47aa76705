"""Real robots as a pure core: odometry and commands in, observations and twists out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from protocol.messages import (
    Accuracy,
    Command,
    Observation,
    Refusal,
    Refusals,
    State,
    TrueRobot,
    Truth,
    Verdict,
)
from protocol.vehicle import Limits
from world.judge import refusal_at
from world.referee import Distances
from world.ros2.cdr import STOP, Odometry, Twist
from world.ros2.odometry import OdometryError, Reading, Stamps, reading_of
from world.ros2.settings import Ros2Bridge, Ros2Robot
from world.vehicle import Vehicle, VehicleState

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


class OdometryWorld:
    """All robots of a bridge, one step after the other.

    Nothing here reads a clock, starts a thread, or does input or output. Every step begins with `look`. A
    robot is in the scene while its odometry is no older than ``stale_s``: only then it is seen, is told what
    it sees, and drives. All others are told to stand.

    A twist holds the speed at the end of the step, and the turn rate. It is integrated from the commanded
    speed rather than from the measured one, which lags behind it; yet it runs ahead of that by no more than
    ``drive_lag_s`` of acceleration, so that a robot that was held back does not start with a jump.

    Args:
        settings: the robots and what is known of them.
        epoch: identifies this world in all its messages.
    """

    def __init__(self, settings: Ros2Bridge, *, epoch: int) -> None:
        self._settings = settings
        self._epoch = epoch
        self._step = FIRST_STEP
        nowhere = VehicleState(0.0, 0.0, 0.0, 0.0)
        self._robots = {
            robot.id: _Robot(robot, Vehicle(robot.limits, settings.step_s, nowhere))
            for robot in settings.robots
        }
        self._distances = Distances(settings.scene())
        self._verdict: Verdict | None = None

    @property
    def step(self) -> int:
        """The present step."""
        return self._step

    @property
    def robots(self) -> tuple[str, ...]:
        """Ids of all robots, in the order of the file."""
        return tuple(self._robots)

    @property
    def present(self) -> tuple[str, ...]:
        """Ids of the robots of which it is known where they are."""
        return tuple(name for name, robot in self._robots.items() if robot.seen)

    @property
    def over(self) -> bool:
        """Whether the run has been ended; by itself it never ends, since nobody here knows a goal."""
        return self._verdict is not None

    def take(self, robot: str, odometry: Odometry, arrived_s: float) -> None:
        """Odometry has come; it counts from the next `look` on.

        Args:
            robot: whose it is.
            odometry: as received.
            arrived_s: when, on the clock of `look`.

        Raises:
            OdometryError: it cannot be used, or is not newer than what was there before.
        """
        known = self._robots[robot]
        reading = reading_of(odometry, known.settings)
        measured_s = known.stamps.measured_s(reading.stamp_ns, arrived_s, self._settings.stale_s)
        if measured_s is None:
            raise OdometryError("not newer than the last one", f"stamp {reading.stamp_ns / 1e9:.9f} s")
        known.reading, known.measured_s = reading, measured_s

    def look(self, now_s: float) -> None:
        """The present step is now: everybody is where odometry says, brought to this moment.

        Args:
            now_s: on the clock of the arrivals.
        """
        for robot in self._robots.values():
            age_s = max(now_s - robot.measured_s, 0.0)
            if robot.reading is None or age_s > self._settings.stale_s:
                robot.seen = None
                robot.vehicle.stand()
            else:
                seen = gone_on(robot.reading, age_s)
                robot.vehicle.state = seen._replace(speed_mps=self._wanted_mps(robot, seen.speed_mps))
                robot.accuracy = self._accuracy(robot.reading, robot.settings.limits, age_s)
                robot.seen = seen
        self._distances.measure({name: robot.seen for name, robot in self._robots.items() if robot.seen})

    def observations(self) -> dict[str, Observation]:
        """What each robot in the scene is told of the present step: all that are, itself included."""
        present = [robot for robot in self._robots.values() if robot.seen]
        states = {robot.settings.id: State.of(*robot.seen) for robot in present if robot.seen}
        observation = Observation(
            epoch=self._epoch,
            step=self._step,
            time_s=self._settings.time_s(self._step),
            robots=states,
            accuracy=_worst([robot.accuracy for robot in present]),
        )
        return dict.fromkeys(states, observation)

    def refusal(self, robot: str, command: Command) -> Refusal | None:
        """Why a command that came from this robot does not answer the present step, None if it does."""
        return refusal_at(self._step, self._epoch, robot, command)

    def twist(self, robot: str, command: Command | None = None) -> Twist:
        """What this robot is to do during the present step.

        Args:
            robot: its id.
            command: that answers the step; None: there is none yet.
        """
        known = self._robots[robot]
        if known.seen is None:
            return STOP
        driven = known.vehicle.driven_by(_counts(command))
        return Twist(driven.state.speed_mps, driven.applied.turn_rate_radps)

    def advance(self, commands: Mapping[str, Command]) -> None:
        """Go on to the next step; `look` says where everybody is then.

        A robot without a command has missed its deadline, which is counted; see
        :class:`world.vehicle.Vehicle` for what it drives. Those that are not in the scene stand.

        Args:
            commands: that answer the present step, by the robot that gave them.
        """
        for name, robot in self._robots.items():
            if robot.seen:
                robot.vehicle.obey(_counts(commands.get(name)))
        self._step += 1

    def interrupt(self) -> None:
        """End the run."""
        self._verdict = self._verdict or "interrupted"

    def truth(self, refused: Refusals | None = None) -> Truth:
        """What the bench is told of the present step: where odometry says that everybody is.

        Nobody arrives, since nobody here knows a goal.

        Args:
            refused: commands that were not taken so far.
        """
        return Truth(
            epoch=self._epoch,
            step=self._step,
            time_s=self._settings.time_s(self._step),
            robots={
                name: TrueRobot(
                    state=State.of(*robot.seen),
                    turn_rate_radps=robot.vehicle.applied.turn_rate_radps,
                    acceleration_mps2=robot.vehicle.applied.acceleration_mps2,
                    arrived_s=None,
                    driven_m=self._distances.driven_m[name],
                    deadline_misses=robot.vehicle.deadline_misses,
                    clipped_commands=robot.vehicle.clipped_commands,
                )
                for name, robot in self._robots.items()
                if robot.seen
            },
            minimum_distance_m=self._distances.minimum_distance_m,
            collisions=self._distances.collisions,
            verdict=self._verdict,
            refused=refused or {},
        )

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


def _counts(command: Command | None) -> Command | None:
    """The command, unless it is there to say that there is none."""
    return None if command is None or command.withheld else command


def _worst(of_each: list[Accuracy]) -> Accuracy:
    """One accuracy for all: an observation tells but one, and nobody is to be seen better than he is."""
    return Accuracy(
        position_m=max((each.position_m for each in of_each), default=0.0),
        heading_rad=max((each.heading_rad for each in of_each), default=0.0),
        speed_mps=max((each.speed_mps for each in of_each), default=0.0),
    )
