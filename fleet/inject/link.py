"""The link between the world and one robot: kinds of faults on it, and how it carries messages with them."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple

import msgpack
from pydantic import Field, PrivateAttr

from fleet.inject.fault import (
    MAX_LATE_STEPS,
    F,
    Fault,
    Ids,
    RobotFault,
    Scheduled,
    Share,
    Steps,
    Strike,
    of_kind,
)
from protocol.codec import MessageError, decode, encode
from protocol.keys import Id
from protocol.messages import Command, Observation, State
from protocol.scene import MAX_ROBOTS, Metres, NonNegative, Scene
from protocol.vehicle import Input, Limits

LARGEST = 1e6
"""Of a coordinate in m, and of an input, that a message can hold; whatever is larger becomes this."""
LONGEST_GARBAGE_BYTES = 256


class ObservationFault(RobotFault):
    """Something happens to observations on their way to the robot; a kind overrides what that is."""

    copies: ClassVar[int] = 1
    """How many come."""
    held_back: ClassVar[bool] = False
    """Whether they come after the next one."""

    def late_steps(self, _strike: Strike) -> int:
        """By how many steps the view of the others is older, and says so; those of several faults add up."""
        return 0

    def states(self, _seen: Observation, _strike: Strike, _scene: Scene) -> Mapping[str, State]:
        """What takes the place of the states seen."""
        return {}

    def payload(self, _seen: Observation, _strike: Strike) -> bytes | None:
        """The bytes that come instead, which no robot should take; None: the observation comes."""
        return None


class Delay(ObservationFault):
    """The view of the others is so many steps old, and says so."""

    kind: Literal["delay"]
    steps: Steps

    def late_steps(self, _strike: Strike) -> int:
        return self.steps


class Jitter(ObservationFault):
    """The view of the others is a random number of steps old, up to so many, and says so."""

    kind: Literal["jitter"]
    steps: Steps

    def late_steps(self, strike: Strike) -> int:
        return int(strike.random.integers(self.steps, endpoint=True))


class Stuck(ObservationFault):
    """One other robot is seen where it was when the fault began, whatever it does; it stays in view."""

    kind: Literal["stuck"]
    seen: Id

    _state: State | None = PrivateAttr(None)

    def states(self, seen: Observation, strike: Strike, _scene: Scene) -> Mapping[str, State]:
        """The first state that was seen since the beginning."""
        if self.seen == strike.robot:
            return {}
        self._state = self._state or seen.robots.get(self.seen)
        return {self.seen: self._state} if self._state else {}


class Ghost(ObservationFault):
    """A robot is seen that does not exist, going straight on with a constant speed."""

    kind: Literal["ghost"]
    x_m: Metres
    y_m: Metres
    heading_rad: Metres = 0.0
    speed_mps: NonNegative = 0.0

    def states(self, seen: Observation, strike: Strike, scene: Scene) -> Mapping[str, State]:
        """Where its way from the beginning leads, as old as the view of all others is; with nobody's name."""
        way_m = (seen.step - seen.age_steps - strike.begin) * scene.step_s * self.speed_mps
        there = State.of(self.x_m, self.y_m, self.heading_rad, self.speed_mps)
        names = ("ghost" if number == 1 else f"ghost-{number}" for number in count(1))
        name = next(name for name in names if name not in scene.robots and name not in seen.robots)
        return {name: _moved(there, way_m * math.cos(self.heading_rad), way_m * math.sin(self.heading_rad))}


class Jump(ObservationFault):
    """One robot, which may be the observer, is seen a distance away, each time in another direction."""

    kind: Literal["jump"]
    seen: Id
    distance_m: Annotated[float, Field(gt=0, le=1e3)]
    rate: Share = 1.0

    def states(self, seen: Observation, strike: Strike, _scene: Scene) -> Mapping[str, State]:
        direction_rad = strike.random.uniform(-math.pi, math.pi)
        x_m, y_m = self.distance_m * math.cos(direction_rad), self.distance_m * math.sin(direction_rad)
        return {name: _moved(state, x_m, y_m) for name, state in seen.robots.items() if name == self.seen}


class Bias(ObservationFault):
    """One robot, which may be the observer, is always seen displaced."""

    kind: Literal["bias"]
    seen: Id
    x_m: Metres
    y_m: Metres

    def states(self, seen: Observation, _strike: Strike, _scene: Scene) -> Mapping[str, State]:
        there = seen.robots.get(self.seen)
        return {self.seen: _moved(there, self.x_m, self.y_m)} if there else {}


def _moved(state: State, x_m: float, y_m: float) -> State:
    return state.model_copy(update={"x_m": _clipped(state.x_m + x_m), "y_m": _clipped(state.y_m + y_m)})


def _clipped(value: float, largest: float = LARGEST) -> float:
    return min(max(value, -largest), largest)


class Loss(ObservationFault):
    """A share of the observations is lost; with a rate of 1, all of them for the duration: a burst."""

    kind: Literal["loss"]
    rate: Share
    copies = 0


class Slow(ObservationFault):
    """A busy neighbour: at a share of the steps the robot does not get to deciding in time."""

    kind: Literal["slow"]
    rate: Share
    copies = 0


class Duplication(ObservationFault):
    """A share of the observations comes twice."""

    kind: Literal["duplication"]
    rate: Share
    copies = 2


class Reordering(ObservationFault):
    """A share of the observations comes after the next one."""

    kind: Literal["reordering"]
    rate: Share
    held_back = True


class NotANumber(ObservationFault):
    """A share of the observations holds NaN where a position should be."""

    kind: Literal["nan"]
    rate: Share

    def payload(self, seen: Observation, strike: Strike) -> bytes:
        """One robot, drawn at each step, is at no place."""
        content = seen.model_dump(mode="python")
        content["robots"][str(strike.random.choice(sorted(seen.robots)))]["x_m"] = math.nan
        return _packed(content)


class Garbage(ObservationFault):
    """A share of the observations is random bytes."""

    kind: Literal["garbage"]
    rate: Share

    def payload(self, _seen: Observation, strike: Strike) -> bytes:
        return strike.random.bytes(int(strike.random.integers(1, LONGEST_GARBAGE_BYTES, endpoint=True)))


class WrongVersion(ObservationFault):
    """A share of the observations states another version of the schema."""

    kind: Literal["wrong-version"]
    rate: Share

    def payload(self, seen: Observation, _strike: Strike) -> bytes:
        return _packed(seen.model_dump(mode="python") | {"schema_version": seen.VERSION + 1})


class WrongEpoch(ObservationFault):
    """A share of the observations belongs to another epoch."""

    kind: Literal["wrong-epoch"]
    rate: Share

    def payload(self, seen: Observation, _strike: Strike) -> bytes:
        return encode(seen.model_copy(update={"epoch": (seen.epoch + 1) % 2**63}))


def _packed(content: dict[str, Any]) -> bytes:
    """Without the checks of our own messages, which would not let this pass."""
    payload: bytes = msgpack.packb(content)
    return payload


class CommandFault(RobotFault):
    """Something happens to commands on their way to the vehicle; a kind overrides what that is."""

    copies: ClassVar[int] = 1
    """How many come."""

    def late_steps(self) -> int:
        """How many steps late they come; those of several faults add up."""
        return 0

    def driven(self, wanted: Input, _limits: Limits) -> Input:
        """What is driven instead of an input, given the limits of the vehicle."""
        return wanted


class CommandExcess(CommandFault):
    """A share of the commands is multiplied by a factor, beyond what the vehicle can do."""

    kind: Literal["command-excess"]
    factor: Annotated[float, Field(gt=0, le=1e4)] = 10.0
    rate: Share = 1.0

    def driven(self, wanted: Input, _limits: Limits) -> Input:
        return Input(*(_clipped(self.factor * each) for each in wanted))


class Weak(CommandFault):
    """The robot accelerates and brakes with only a part of what its limits promise."""

    kind: Literal["weak"]
    robots: Ids
    factor: Share = 0.5

    def driven(self, wanted: Input, limits: Limits) -> Input:
        strongest = self.factor * limits.acceleration_mps2
        return wanted._replace(acceleration_mps2=_clipped(wanted.acceleration_mps2, strongest))


class CommandLoss(CommandFault):
    """A share of the commands is lost."""

    kind: Literal["command-loss"]
    rate: Share
    copies = 0


class CommandDelay(CommandFault):
    """A share of the commands comes so many steps late."""

    kind: Literal["command-delay"]
    steps: Steps
    rate: Share = 1.0

    def late_steps(self) -> int:
        return self.steps


class CommandDuplication(CommandFault):
    """A share of the commands comes twice."""

    kind: Literal["command-duplication"]
    rate: Share
    copies = 2


LINK_FAULTS: Final = (ObservationFault, CommandFault)
"""Kinds that lie on links; a robot that none of them befalls needs none."""


class Delivery(NamedTuple):
    """What reaches a robot at a step."""

    payloads: tuple[bytes, ...]
    """In this order."""
    answerable: bool
    """Whether the step's own observation is among them, intact; if not, no command of it is to be awaited."""


NOTHING: Final = Delivery((), answerable=False)


class Link:
    """Hands on what the world and one robot say to each other, as the faults of a run let it.

    What is random follows from the seed of the run, the robot and the step; nothing here reads a clock. One
    link serves one epoch of the world.

    The view of the others becomes older first, then states change in the order of the faults in their list,
    and last comes what is done to the bytes on their way. An input changes in the order of the list, too.

    Args:
        faults: of the run; those that do not lie on this link change nothing.
        robot: at the other end.
        scene: of the run.
    """

    def __init__(self, faults: Sequence[Scheduled[Fault]], robot: str, scene: Scene) -> None:
        self._robot = robot
        self._scene = scene
        self._faults = [each.anew() for each in of_kind(faults, LINK_FAULTS, robot)]
        self._past: deque[Observation] = deque(maxlen=len(self._faults) * MAX_LATE_STEPS + 1)
        self._held_back: bytes | None = None
        self._late_commands: list[tuple[int, bytes]] = []

    def observed(self, observation: Observation) -> Delivery:
        """What reaches the robot when the world shows it something, at a step after the last one."""
        self._past.append(observation)
        striking = self._striking(ObservationFault, observation.step)
        seen = self._seen(observation, striking)
        copies = [fault.copies for fault, _ in striking]
        if 0 in copies:
            return NOTHING
        for fault, strike in striking:
            if (instead := fault.payload(seen, strike)) is not None:
                return Delivery((instead,), answerable=False)
        payload, earlier = encode(seen), self._held_back
        if earlier is None and any(fault.held_back for fault, _ in striking):
            self._held_back = payload
            return NOTHING
        self._held_back = None
        after = () if earlier is None else (earlier,)
        return Delivery((payload,) * max(copies, default=1) + after, answerable=True)

    def commanded(self, payload: bytes) -> tuple[bytes, ...]:
        """What reaches the world now of a command that the robot gives.

        Where the command itself does not, that is one which says that it is withheld, so that it is not
        waited for.
        """
        try:
            command = decode(Command, payload)
        except MessageError:
            return (payload,)  # the world refuses and counts it
        striking = [fault for fault, _ in self._striking(CommandFault, command.step)]
        for fault in striking:
            command = self._driven(command, fault)
        changed, copies = encode(command), [fault.copies for fault in striking]
        late_steps = sum(fault.late_steps() for fault in striking)
        if late_steps and 0 not in copies:
            self._late_commands.append((command.step + late_steps, changed))
        if late_steps or 0 in copies:
            return (encode(Command.withheld_at(command.epoch, command.robot, command.step)),)
        return (changed,) * max(copies, default=1)

    def due(self, step: int) -> tuple[bytes, ...]:
        """Commands that were delayed and reach the world at a step, before those of the step itself."""
        come = tuple(payload for when, payload in self._late_commands if when <= step)
        self._late_commands = [each for each in self._late_commands if each[0] > step]
        return come

    def _striking(self, group: type[F], step: int) -> list[tuple[F, Strike]]:
        """The faults of a group that strike at a step."""
        strikes = ((each.fault, each.strike(self._robot, step)) for each in of_kind(self._faults, group))
        return [(fault, strike) for fault, strike in strikes if strike is not None]

    def _seen(self, now: Observation, striking: list[tuple[ObservationFault, Strike]]) -> Observation:
        """The observation with an older view of the others and with other states."""
        seen = now
        if late_steps := sum(fault.late_steps(strike) for fault, strike in striking):
            past = (each for each in reversed(self._past) if each.step <= now.step - late_steps)
            then = next(past, self._past[0])  # until there is one so old, the first one stands
            own = {name: state for name, state in now.robots.items() if name == self._robot}
            others = {name: state for name, state in then.robots.items() if name != self._robot}
            age_steps = now.step - then.step + then.age_steps
            seen = now.model_copy(update={"robots": {**others, **own}, "age_steps": age_steps})
        for fault, strike in striking:
            robots = {**seen.robots, **fault.states(seen, strike, self._scene)}
            if len(robots) <= MAX_ROBOTS:  # no observation holds more
                seen = seen.model_copy(update={"robots": robots})
        return seen

    def _driven(self, command: Command, fault: CommandFault) -> Command:
        """The command with another input."""
        limits = self._scene.robot(self._robot).limits
        turn_rate, acceleration = fault.driven(command.input, limits)
        changes = {"turn_rate_radps": turn_rate, "acceleration_mps2": acceleration}
        return command.model_copy(update=changes)
