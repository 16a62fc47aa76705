"""What may be made to break in a run: one record a fault, as a scenario or a file of its own lists them.

A fault has a kind, which says what breaks and how; it names the robots that it befalls, when it begins and
how long it lasts. What is random about it follows from the run's seed and its place in the list. The same
list means the same for real processes and in virtual time.
"""

from collections.abc import Collection, Sequence
from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, field_validator

from chassis.files import Record
from protocol.keys import Id
from protocol.scene import Metres, NonNegative, Weights

MAX_FAULTS = 256
MAX_LATE_STEPS = 10

Share = Annotated[float, Field(gt=0, le=1)]
"""A probability at each step."""
Time = Annotated[float, Field(ge=0, le=1e5)]
Steps = Annotated[int, Field(ge=1, le=MAX_LATE_STEPS)]


def as_tuple(value: object) -> object:
    """A list, as YAML has it, for a field that is a tuple."""
    return tuple(value) if isinstance(value, Sequence) and not isinstance(value, str) else value


Ids = Annotated[tuple[Id, ...], BeforeValidator(as_tuple), Field(min_length=1, max_length=128)]
Interval = Annotated[tuple[Time, Time], BeforeValidator(as_tuple)]


def _time_or_interval(value: object) -> str:
    return "interval" if isinstance(value, Sequence) and not isinstance(value, str) else "time"


class _Fault(Record):
    """When: at a time, or at one drawn from an interval, in simulated seconds since step 0."""

    start_s: Annotated[
        Annotated[Time, Tag("time")] | Annotated[Interval, Tag("interval")], Discriminator(_time_or_interval)
    ] = 0.0
    """A pair stands for a time drawn between both, from the seed of the run."""
    duration_s: Annotated[float, Field(gt=0, le=1e5)] | None = None
    """None: to the end of the run."""

    @field_validator("start_s")
    @classmethod
    def _interval_is_in_order(cls, start_s: float | tuple[float, float]) -> float | tuple[float, float]:
        if isinstance(start_s, tuple) and start_s[0] > start_s[1]:
            raise ValueError("the first time of the interval must not be after the second")
        return start_s


class _OfRobots(_Fault):
    robots: Ids | None = None
    """Whom it befalls; None: every robot, each by draws of its own."""


class _OfNamedRobots(_Fault):
    """Kinds that would leave no healthy robot if they befell everybody unasked."""

    robots: Ids


# Processes.


class Kill(_OfNamedRobots):
    """The robot's process is killed; with a duration it is started again after it, otherwise never."""

    kind: Literal["kill"]


class Freeze(_OfNamedRobots):
    """The robot's process is stopped, and goes on after the duration."""

    kind: Literal["freeze"]


class Slow(_OfRobots):
    """A busy neighbour: at a share of the steps the robot does not get to deciding in time."""

    kind: Literal["slow"]
    rate: Share


class RestartWorld(_Fault):
    """The world's process is killed, and started again after the duration, from step 0 in a new epoch."""

    kind: Literal["restart-world"]
    duration_s: Annotated[float, Field(gt=0, le=60)] = 1.0


# What one robot observes.


class Loss(_OfRobots):
    """Observations are lost; with a rate of 1, all of them for the duration: a burst."""

    kind: Literal["loss"]
    rate: Share


class Delay(_OfRobots):
    """The view of the others is so many steps old, and says so."""

    kind: Literal["delay"]
    steps: Steps


class Jitter(_OfRobots):
    """The view of the others is a random number of steps old, up to so many, and says so."""

    kind: Literal["jitter"]
    steps: Steps


class Duplication(_OfRobots):
    """A share of the observations comes twice."""

    kind: Literal["duplication"]
    rate: Share


class Reordering(_OfRobots):
    """A share of the observations comes after the next one."""

    kind: Literal["reordering"]
    rate: Share


class Stuck(_OfRobots):
    """One other robot is seen where it was when the fault began, whatever it does."""

    kind: Literal["stuck"]
    seen: Id


class Ghost(_OfRobots):
    """A robot is seen that does not exist, going straight on with a constant speed."""

    kind: Literal["ghost"]
    x_m: Metres
    y_m: Metres
    heading_rad: Metres = 0.0
    speed_mps: NonNegative = 0.0


class Jump(_OfRobots):
    """At a share of the steps one robot, which may be the observer, is seen a distance away."""

    kind: Literal["jump"]
    seen: Id
    distance_m: Annotated[float, Field(gt=0, le=1e3)]
    rate: Share = 1.0


class Bias(_OfRobots):
    """One robot, which may be the observer, is always seen displaced."""

    kind: Literal["bias"]
    seen: Id
    x_m: Metres
    y_m: Metres


class NotANumber(_OfRobots):
    """A share of the observations holds NaN where a position should be."""

    kind: Literal["nan"]
    rate: Share


class Garbage(_OfRobots):
    """A share of the observations is random bytes."""

    kind: Literal["garbage"]
    rate: Share


class WrongVersion(_OfRobots):
    """A share of the observations states another version of the schema."""

    kind: Literal["wrong-version"]
    rate: Share


class WrongEpoch(_OfRobots):
    """A share of the observations belongs to another epoch."""

    kind: Literal["wrong-epoch"]
    rate: Share


# What one robot commands.


class CommandLoss(_OfRobots):
    """A share of the commands is lost."""

    kind: Literal["command-loss"]
    rate: Share


class CommandDelay(_OfRobots):
    """A share of the commands comes so many steps late."""

    kind: Literal["command-delay"]
    steps: Steps
    rate: Share = 1.0


class CommandDuplication(_OfRobots):
    """A share of the commands comes twice."""

    kind: Literal["command-duplication"]
    rate: Share


class CommandExcess(_OfRobots):
    """A share of the commands is multiplied by a factor, beyond what the vehicle can do."""

    kind: Literal["command-excess"]
    factor: Annotated[float, Field(gt=0, le=1e4)] = 10.0
    rate: Share = 1.0


# How a robot behaves.


class StopsDead(_OfNamedRobots):
    """The robot brakes to a standstill and stays there."""

    kind: Literal["stops"]


class Ignores(_OfNamedRobots):
    """The robot drives to its goal as if it were alone."""

    kind: Literal["ignores"]


class TurnsBack(_OfNamedRobots):
    """The robot wants to go back to where it started."""

    kind: Literal["turns-back"]


class Chases(_OfNamedRobots):
    """The robot drives at another one, wherever that goes, and minds nobody."""

    kind: Literal["chases"]
    seen: Id


class Weak(_OfNamedRobots):
    """The robot accelerates and brakes with only a part of what its limits promise."""

    kind: Literal["weak"]
    factor: Share = 0.5


class OtherCost(_OfNamedRobots):
    """The robot weighs its way by another Q than the scene says."""

    kind: Literal["other-cost"]
    weights: Weights


class ArrivesLate(_OfNamedRobots):
    """The robot is not there before; nobody sees it or can meet it. It has no duration."""

    kind: Literal["arrives-late"]


class Leaves(_OfNamedRobots):
    """The robot is gone from then on; with a duration it comes back where it left."""

    kind: Literal["leaves"]


# Its solver.


class NoTime(_OfRobots):
    """The time budget of every decision is nothing."""

    kind: Literal["no-time"]


class SolverFailure(_OfRobots):
    """At a share of the steps no trajectory problem is solved."""

    kind: Literal["solver-failure"]
    rate: Share = 1.0


class Infeasible(_OfRobots):
    """An obstacle stands on top of the robot in every trajectory problem: no distance can be kept."""

    kind: Literal["infeasible"]


# Clocks.


class ClockStep(_OfRobots):
    """The wall clock of the robots jumps; nothing may depend on it."""

    kind: Literal["clock-step"]
    offset_s: Annotated[float, Field(ge=-1e9, le=1e9)]


class Pause(_Fault):
    """The whole machine stands still for the duration, counted in real time."""

    kind: Literal["pause"]
    duration_s: Annotated[float, Field(gt=0, le=60)] = 1.0


# The recording.


class DiskFull(_Fault):
    """The disk takes nothing more of the recording."""

    kind: Literal["disk-full"]


class RecorderDies(_Fault):
    """The bench, which records, is killed."""

    kind: Literal["recorder-dies"]


Fault = Annotated[
    Kill
    | Freeze
    | Slow
    | RestartWorld
    | Loss
    | Delay
    | Jitter
    | Duplication
    | Reordering
    | Stuck
    | Ghost
    | Jump
    | Bias
    | NotANumber
    | Garbage
    | WrongVersion
    | WrongEpoch
    | CommandLoss
    | CommandDelay
    | CommandDuplication
    | CommandExcess
    | StopsDead
    | Ignores
    | TurnsBack
    | Chases
    | Weak
    | OtherCost
    | ArrivesLate
    | Leaves
    | NoTime
    | SolverFailure
    | Infeasible
    | ClockStep
    | Pause
    | DiskFull
    | RecorderDies,
    Field(discriminator="kind"),
]

Faults = Annotated[tuple[Fault, ...], BeforeValidator(as_tuple), Field(max_length=MAX_FAULTS)]


class FaultFile(Record):
    """A file of faults alone."""

    faults: Annotated[Faults, Field(min_length=1)]


def unknown_robot(faults: Sequence[Fault], robots: Collection[str]) -> tuple[str, str] | None:
    """The first place in a list of faults that names a robot which does not exist, and what is wrong there.

    Args:
        faults: the list.
        robots: ids of those that exist.
    """
    for index, fault in enumerate(faults):
        named = {f"robots.{place}": name for place, name in enumerate(getattr(fault, "robots", None) or ())}
        if seen := getattr(fault, "seen", None):
            named["seen"] = seen
        for place, name in named.items():
            if name not in robots:
                what = f"there is no robot {name!r}; the robots are {', '.join(robots)}"
                return f"faults.{index}.{place}", what
    return None
