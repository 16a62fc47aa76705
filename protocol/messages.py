"""The messages of the bus: msgpack maps with a schema version, refused on arrival unless wholly valid.

All positions are in metres and all headings in radians in the one frame of the area (x to the right, y up,
headings counter-clockwise from x, wrapped to [−π, π]); speeds are in m/s along the heading; times are in
seconds since step 0. A step is one interval Δt: the world publishes the observation of step k, a robot
answers it with the command of step k, which the world applies until step k + 1. Where that command does not
come in time, the world brakes the robot at once.
"""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field

from chassis.files import Record
from protocol.keys import Name
from protocol.scene import MAX_ROBOTS, Scene
from protocol.vehicle import Input, wrap_angle
from protocol.version import PROTOCOL_VERSION

MAX_HORIZON = 200
MAX_PAYLOAD_BYTES = 256 * 1024

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Count = Annotated[int, Field(ge=0, le=2**53)]
Seconds = Annotated[float, Field(ge=0, le=1e9)]
Epoch = Annotated[int, Field(ge=0, lt=2**63)]


class Said(Record):
    """Whatever is said on the bus. It states its version, so that a reader refuses what it does not know."""

    VERSION: ClassVar[int] = PROTOCOL_VERSION
    MAX_BYTES: ClassVar[int] = MAX_PAYLOAD_BYTES
    """Of a payload."""
    schema_version: Annotated[int, Field(ge=PROTOCOL_VERSION, le=PROTOCOL_VERSION)] = PROTOCOL_VERSION


class Joining(Said):
    """Question on ``scene/<robot>``: a robot wants to know the scene, and says which version it speaks."""

    MAX_BYTES: ClassVar[int] = 1024


class Message(Said):
    """Whatever belongs to one run of a world."""

    epoch: Epoch
    """Drawn anew by every world: messages of another epoch belong to another run of the world."""


class State(Record):
    """One robot's state (p_x, p_y, ψ, v) of eq. 8."""

    x_m: Coordinate
    y_m: Coordinate
    heading_rad: Coordinate
    speed_mps: Coordinate

    @classmethod
    def of(cls, x_m: float, y_m: float, heading_rad: float, speed_mps: float) -> Self:
        """A state as messages carry it: with its heading wrapped to [−π, π]."""
        return cls(x_m=x_m, y_m=y_m, heading_rad=wrap_angle(heading_rad), speed_mps=speed_mps)

    def as_tuple(self) -> tuple[float, float, float, float]:
        """(p_x, p_y, ψ, v)."""
        return (self.x_m, self.y_m, self.heading_rad, self.speed_mps)


Robots = Annotated[dict[Name, State], Field(max_length=MAX_ROBOTS)]
Deviation = Annotated[float, Field(ge=0, le=1e6)]


class Accuracy(Record):
    """Standard deviations of what a sensor measures; zero: exact."""

    position_m: Deviation = 0.0
    """Of each coordinate."""
    heading_rad: Deviation = 0.0
    speed_mps: Deviation = 0.0

    def as_tuple(self) -> tuple[float, float, float, float]:
        """Of (p_x, p_y, ψ, v)."""
        return (self.position_m, self.position_m, self.heading_rad, self.speed_mps)


class Observation(Message):
    """``pose/<robot>``: what one robot's sensors see at a step, itself included."""

    step: Count
    time_s: Seconds
    robots: Robots
    age_steps: Count = 0
    """How many steps ago the others were where they are seen; the robot's own state is of this step."""
    accuracy: Accuracy = Accuracy()
    """Of all these states, as the sensors themselves know it."""


class Command(Message):
    """``command/<robot>``: the input with which a robot answers one observation."""

    MAX_BYTES: ClassVar[int] = 1024
    robot: Name
    step: Count
    turn_rate_radps: Coordinate
    acceleration_mps2: Coordinate
    withheld: bool = False
    """True: there is no command for this step, and none is to be awaited; the inputs mean nothing."""

    @classmethod
    def withheld_at(cls, epoch: int, robot: str, step: int) -> Self:
        """What a robot says that has nothing to say, such as one that does not see itself."""
        return cls(
            epoch=epoch,
            robot=robot,
            step=step,
            turn_rate_radps=0.0,
            acceleration_mps2=0.0,
            withheld=True,
        )

    @property
    def input(self) -> Input:
        """(ω, a)."""
        return Input(self.turn_rate_radps, self.acceleration_mps2)


class PublicScene(Message):
    """Reply of ``scene`` and ``scene/<robot>``: what everybody may know."""

    scene: Scene


Verdict = Literal["arrived", "collision", "deadlock", "timeout", "interrupted"]


class TrueRobot(Record):
    """One robot as the referee sees it."""

    state: State
    turn_rate_radps: Coordinate
    acceleration_mps2: Coordinate
    arrived_s: Seconds | None
    driven_m: Seconds
    deadline_misses: Count
    clipped_commands: Count


Refusal = Literal[
    "not a valid message",
    "names another robot",
    "answers another epoch",
    "answers another step",
    "answers a step again",
]
"""Why a robot's command, or its mind, is not taken."""

Refusals = dict[Name, dict[Refusal, Count]]
"""How often, by robot and reason; only what happened stands there."""


class Truth(Message):
    """``truth``: true states at a step with the inputs that led there, and the referee's counts so far."""

    step: Count
    time_s: Seconds
    robots: Annotated[dict[Name, TrueRobot], Field(max_length=MAX_ROBOTS)]
    minimum_distance_m: Seconds | None
    """Smallest distance of two centres so far; none with a single robot."""
    collisions: Annotated[tuple[tuple[Name, Name], ...], Field(max_length=MAX_ROBOTS**2)]
    """Pairs that have come closer than their bodies allow, each once."""
    refused: Annotated[Refusals, Field(max_length=MAX_ROBOTS)]
    """Commands that the world has not taken so far."""
    verdict: Verdict | None
    """None while the run goes on; set on the last message of the epoch."""


Milliseconds = Annotated[float, Field(ge=0, le=1e9)]
Positions = Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(max_length=MAX_HORIZON + 1)]


class Timings(Record):
    """Wall-clock time of the phases of one decision, in ms; a phase that did not run took none."""

    estimate: Milliseconds = 0.0
    predict: Milliseconds = 0.0
    plan: Milliseconds = 0.0
    decide: Milliseconds = 0.0


Phase = Literal["predict", "plan"]

Degradation = Literal["extrapolation", "gate", "controlled stop", "solver failure", "intervention"]
"""Why a robot does not drive as it would: it goes by where robots should be that it does not see; it has
refused what no vehicle could have done; it stops until it sees enough; it could not solve a problem; or the
reserve or the last resort holds it back."""


class Mind(Message):
    """``mind/<robot>``: what a robot thought at a step; for recording and looking, never for robots."""

    robot: Name
    step: Count
    decision: Count
    """How many decisions the robot had made before this one since it joined: at 0 it remembers nothing."""
    arrived: bool
    estimates: Robots
    """Estimated goal states of all robots, the ego's as the others would estimate it."""
    prediction: Annotated[dict[Name, Positions], Field(max_length=MAX_ROBOTS)]
    """Jointly predicted positions for the present and every step of the horizon."""
    plan: Positions
    """The ego's planned positions, from the present on."""
    failed: Annotated[tuple[Phase, ...], Field(max_length=2)]
    """Phases whose problem was not solved at this step."""
    solver_failures: Count
    """Problems not solved so far, since the robot joined this epoch."""
    degraded: Annotated[tuple[Degradation, ...], Field(max_length=8)] = ()
    """In which ways the robot is degraded at this step; empty: it is not."""
    interventions: Count = 0
    """How often the reserve or the last resort has begun to hold the robot back so far."""
    cut_short_at: Count | None
    """At which question whether its time is over, counted from 0, it was; None: it had time enough."""
    timings_ms: Timings
