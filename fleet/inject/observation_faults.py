"""Kinds of faults between the world and one robot's inbox: what it sees, how late, and in which bytes."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import msgpack
from pydantic import Field, PrivateAttr

from fleet.inject.fault import RobotFault, Share, Steps, Strike
from protocol.codec import encode
from protocol.keys import Id
from protocol.messages import Observation, State
from protocol.scene import Metres, NonNegative, Scene

FARTHEST_M = 1e6
"""Coordinates beyond cannot be told; what would be seen there is seen here."""
LONGEST_GARBAGE_BYTES = 256


class AgeFault(RobotFault):
    """The view of the others is older, and says so; ages of several faults add up."""

    def late_steps(self, strike: Strike) -> int:
        """By so many steps."""
        raise NotImplementedError


class Delay(AgeFault):
    """The view of the others is so many steps old, and says so."""

    kind: Literal["delay"]
    steps: Steps

    def late_steps(self, _strike: Strike) -> int:
        return self.steps


class Jitter(AgeFault):
    """The view of the others is a random number of steps old, up to so many, and says so."""

    kind: Literal["jitter"]
    steps: Steps

    def late_steps(self, strike: Strike) -> int:
        return int(strike.random.integers(self.steps, endpoint=True))


class SightFault(RobotFault):
    """Somebody is seen in another state than the world says."""

    def states(self, seen: Observation, strike: Strike, scene: Scene) -> Mapping[str, State]:
        """The states that take the place of those seen."""
        raise NotImplementedError


class Stuck(SightFault):
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


class Ghost(SightFault):
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
        taken = {*scene.robots, *seen.robots}
        names = ("ghost" if number == 1 else f"ghost-{number}" for number in range(1, len(taken) + 2))
        name = next(name for name in names if name not in taken)
        return {name: _moved(there, way_m * math.cos(self.heading_rad), way_m * math.sin(self.heading_rad))}


class Jump(SightFault):
    """One robot, which may be the observer, is seen a distance away, each time in another direction."""

    kind: Literal["jump"]
    seen: Id
    distance_m: Annotated[float, Field(gt=0, le=1e3)]
    rate: Share = 1.0

    def states(self, seen: Observation, strike: Strike, _scene: Scene) -> Mapping[str, State]:
        if self.seen not in seen.robots:
            return {}
        direction_rad = strike.random.uniform(-math.pi, math.pi)
        x_m, y_m = self.distance_m * math.cos(direction_rad), self.distance_m * math.sin(direction_rad)
        return {self.seen: _moved(seen.robots[self.seen], x_m, y_m)}


class Bias(SightFault):
    """One robot, which may be the observer, is always seen displaced."""

    kind: Literal["bias"]
    seen: Id
    x_m: Metres
    y_m: Metres

    def states(self, seen: Observation, _strike: Strike, _scene: Scene) -> Mapping[str, State]:
        return (
            {self.seen: _moved(seen.robots[self.seen], self.x_m, self.y_m)}
            if self.seen in seen.robots
            else {}
        )


def _moved(state: State, x_m: float, y_m: float) -> State:
    x_m, y_m = (min(max(each, -FARTHEST_M), FARTHEST_M) for each in (state.x_m + x_m, state.y_m + y_m))
    return state.model_copy(update={"x_m": x_m, "y_m": y_m})


class DeliveryFault(RobotFault):
    """Observations do not come once and in their order."""

    copies: ClassVar[int] = 1
    """How many come."""
    held_back: ClassVar[bool] = False
    """Until after the next one."""


class Loss(DeliveryFault):
    """A share of the observations is lost; with a rate of 1, all of them for the duration: a burst."""

    kind: Literal["loss"]
    rate: Share
    copies = 0


class Slow(DeliveryFault):
    """A busy neighbour: at a share of the steps the robot does not get to deciding in time."""

    kind: Literal["slow"]
    rate: Share
    copies = 0


class Duplication(DeliveryFault):
    """A share of the observations comes twice."""

    kind: Literal["duplication"]
    rate: Share
    copies = 2


class Reordering(DeliveryFault):
    """A share of the observations comes after the next one."""

    kind: Literal["reordering"]
    rate: Share
    held_back = True


class PayloadFault(RobotFault):
    """A share of the observations comes as bytes that no robot should take."""

    rate: Share

    def payload(self, seen: Observation, strike: Strike) -> bytes:
        raise NotImplementedError


class NotANumber(PayloadFault):
    """A share of the observations holds NaN where a position should be."""

    kind: Literal["nan"]

    def payload(self, seen: Observation, strike: Strike) -> bytes:
        """One robot, drawn at each step, is at no place."""
        content = seen.model_dump(mode="python")
        content["robots"][str(strike.random.choice(sorted(seen.robots)))]["x_m"] = math.nan
        return _packed(content)


class Garbage(PayloadFault):
    """A share of the observations is random bytes."""

    kind: Literal["garbage"]

    def payload(self, _seen: Observation, strike: Strike) -> bytes:
        return strike.random.bytes(int(strike.random.integers(1, LONGEST_GARBAGE_BYTES, endpoint=True)))


class WrongVersion(PayloadFault):
    """A share of the observations states another version of the schema."""

    kind: Literal["wrong-version"]

    def payload(self, seen: Observation, _strike: Strike) -> bytes:
        return _packed(seen.model_dump(mode="python") | {"schema_version": seen.VERSION + 1})


class WrongEpoch(PayloadFault):
    """A share of the observations belongs to another epoch."""

    kind: Literal["wrong-epoch"]

    def payload(self, seen: Observation, _strike: Strike) -> bytes:
        return encode(seen.model_copy(update={"epoch": (seen.epoch + 1) % 2**63}))


def _packed(content: dict[str, Any]) -> bytes:
    """Without the checks of our own messages, which would not let this pass."""
    payload: bytes = msgpack.packb(content)
    return payload
