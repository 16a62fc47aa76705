"""The public scene: what every robot and the world agree on before a run. Its one schema stands here."""

from collections.abc import Iterable
from typing import Annotated, Self

from pydantic import Field, model_validator

from chassis.files import Record
from protocol.keys import Name
from protocol.vehicle import Limits

MAX_ROBOTS = 128

NonNegative = Annotated[float, Field(ge=0, le=1e6)]
Metres = Annotated[float, Field(ge=-1e6, le=1e6)]


class Area(Record):
    """The drivable rectangle (table 1: ±10 m)."""

    x_min_m: Metres = -10.0
    x_max_m: Metres = 10.0
    y_min_m: Metres = -10.0
    y_max_m: Metres = 10.0

    @model_validator(mode="after")
    def _is_not_empty(self) -> Self:
        if self.x_min_m >= self.x_max_m or self.y_min_m >= self.y_max_m:
            raise ValueError("the area is empty: each minimum must lie below its maximum")
        return self

    def contains(self, x_m: float, y_m: float) -> bool:
        """Whether a point lies inside or on the border."""
        return self.x_min_m <= x_m <= self.x_max_m and self.y_min_m <= y_m <= self.y_max_m


class Horizons(Record):
    """Numbers of steps looked ahead (K_P) and back (K_E) (table 1)."""

    prediction_steps: Annotated[int, Field(ge=2, le=200)] = 30
    estimation_steps: Annotated[int, Field(ge=2, le=200)] = 15


class Weights(Record):
    """Diagonal of Q in the cost (x − L)ᵀ Q (x − L) (eq. 11).

    The publication does not state Q; these values let every robot park and give durations in the published
    range.
    """

    x: NonNegative = 1.0
    y: NonNegative = 1.0
    heading: NonNegative = 0.03
    speed: NonNegative = 0.6

    def as_tuple(self) -> tuple[float, float, float, float]:
        """The diagonal of Q."""
        return (self.x, self.y, self.heading, self.speed)


class Goal(Record):
    """A goal pose; the goal speed is zero."""

    x_m: Metres
    y_m: Metres
    heading_rad: Metres

    def as_state(self) -> tuple[float, float, float, float]:
        """The goal state x_F."""
        return (self.x_m, self.y_m, self.heading_rad, 0.0)


class PublicRobot(Record):
    """What everybody may know of one robot."""

    radius_m: Annotated[float, Field(gt=0, le=100)] = 0.495
    """Of the circle around the body: 0.7·√2/2 in the publication."""
    limits: Limits = Limits()


class Rules(Record):
    """What holds for all robots of a run."""

    step_s: Annotated[float, Field(gt=0, le=10)] = 0.1
    area: Area = Area()
    horizons: Horizons = Horizons()
    weights: Weights = Weights()
    arrival_tolerance: Annotated[float, Field(gt=0, le=10)] = 0.1
    safety_margin_m: Annotated[float, Field(ge=0, le=100)] = 0.2
    """Kept around every body beyond its radius."""

    def time_s(self, step: int) -> float:
        """The time of a step in s, to the nanosecond: 9.6, not 9.600000000000001."""
        return round(step * self.step_s, 9)


class Scene(Rules):
    """What everybody may know."""

    robots: Annotated[dict[Name, PublicRobot], Field(min_length=1, max_length=MAX_ROBOTS)]
    goals: Annotated[dict[Name, Goal], Field(max_length=MAX_ROBOTS)] | None = None
    """None unless the run is one with exchanged goals."""

    def robot(self, robot: str) -> PublicRobot:
        """What is known of a robot; one that the scene does not name is taken for the largest known."""
        known = self.robots.get(robot)
        return known if known is not None else max(self.robots.values(), key=lambda each: each.radius_m)

    def collision_distance_m(self, one: str, other: str) -> float:
        """Centres closer than this have collided (published: 0.99 m)."""
        return self.robot(one).radius_m + self.robot(other).radius_m

    def safety_distance_m(self, one: str, other: str) -> float:
        """Centres are planned to stay this far apart: d of eq. 10 (published: 1.39 m)."""
        return self.safety_distances_m([one], [other])[0][0]

    def safety_distances_m(self, ones: Iterable[str], others: Iterable[str]) -> list[list[float]]:
        """The same for each of some robots, and each of others."""
        first, second = ([self.robot(each).radius_m for each in robots] for robots in (ones, others))
        return [[one + other + 2.0 * self.safety_margin_m for other in second] for one in first]
