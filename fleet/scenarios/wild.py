"""The family ``wild``: crossings of robots that have little in common, as a map from the unit cube.

Nothing in it was chosen for the robots' sake: ways, bodies, limits, Δt, horizons and weights are free over
the ranges of vehicles that exist, and only tied to one another where a run would be pointless otherwise.
Robots are placed so that they meet: each as far from a common middle as it drives in about the same time.

A random point of the cube is a draw of the family. ``unspoken hunt`` searches the same cube for the points
that hurt most, so a small change of a coordinate changes the scenario a little, nearly everywhere.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from chassis.refusal import Refusal
from fleet.evaluate.evaluation import AS_IN_THE_FILE, sensing_of
from fleet.inject.scenario import Scenario
from protocol.scenario import Pose, ScenarioRobot, Sensing
from protocol.scene import Area, Horizons, Weights
from protocol.vehicle import Limits, stopping_time_s

FEWEST, MOST = 2, 8
"""Robots of a scenario."""
SHORTEST_M, LONGEST_M = 3.0, 60.0
"""Ways from start to goal, as the crow flies."""
SLOWEST_MPS, FASTEST_MPS = 0.2, 6.0
"""A crawler, and a courier."""
STRONGEST_MPS2 = 4.0
"""Acceleration that wheels pass on to the ground without slipping."""
SMALLEST_M, LARGEST_M = 0.1, 1.0
"""Radii of bodies."""
LEAST_MARGIN_M = 0.1
"""Five standard deviations of a position at low noise: two of these lie between safety and contact."""
SHORTEST_STEP_S, LONGEST_STEP_S = 0.05, 0.2
MOST_STEPS = 1500
"""Of a run: decides how slow robots may be for their ways."""
WAY_STEPS = 300
"""In which a robot at its speed drives its way: a fifth of a run leaves time to start, turn and wait."""
STOP_STEPS = 40
"""In which a robot stops at most, so that no horizon costs much more than the publication's 30 steps."""
FEWEST_STEPS = 15
"""Of a horizon, half of the publication's: robots that stop at once should see where they go all the same."""
WEIGHTS_DECADES = 4.0
"""Of the cost, around the usual one."""
ROOM = 1.1
"""Two places of robots are this many safety distances apart, at least."""
BEND_RAD = math.radians(60.0)
"""By which start and goal differ at most from lying opposite each other; half of them, by less than 8°."""
STRAIGHT = 0.7
"""Share of headings that are those of the way."""
LEVELS = (AS_IN_THE_FILE, "low", "medium")
"""Of noise, in equal shares."""
MOST_DROPOUT, MOST_DELAY_STEPS = 0.3, 2

WildName = Literal["wild", "wild-noisy"]
Point = tuple[float, float]
Place = tuple[Point, float]
"""A point, and the radius of the body there with its margin, in m."""


class Shared(NamedTuple):
    """Coordinates of the cube, each in [0, 1], that concern all robots."""

    step: float
    radius: float
    radius_spread: float
    margin: float
    distance: float
    """From the middle, of a robot with the scenario's usual limits."""
    speed: float
    speed_spread: float
    weights: float
    heading_weight: float
    speed_weight: float
    horizon: float
    memory: float
    """The estimation horizon."""


class Own(NamedTuple):
    """Coordinates of the cube, each in [0, 1], that concern one robot."""

    radius: float
    speed: float
    stop: float
    """How long it takes to stop."""
    jerk: float
    turn_rate: float
    turn_acceleration: float
    direction: float
    """From the middle to its start."""
    bend: float
    lead: float
    """How much earlier or later than others it is at the middle."""
    goal_distance: float
    start_heading: float
    goal_heading: float


class Seen(NamedTuple):
    """Coordinates of the cube, each in [0, 1], that concern what robots see; without them, they see all."""

    noise: float
    dropout: float
    delay: float


def coordinates(robots: int, *, noisy: bool = False) -> int:
    """Number of coordinates of the cube, so many of which make a scenario for this number of robots.

    Raises:
        Refusal: the family has no such scenarios.
    """
    if not FEWEST <= robots <= MOST:
        raise Refusal(f"the family wild has scenarios of {FEWEST} to {MOST} robots, not of {robots}")
    return len(Shared._fields) + robots * len(Own._fields) + noisy * len(Seen._fields)


def wild(robots: int, random: np.random.Generator) -> Scenario:
    """Robots of any size, speed and way, which see each other perfectly.

    Raises:
        Refusal: there are too few or too many robots.
    """
    return scenario_at(random.random(coordinates(robots)).tolist(), robots)


def wild_noisy(robots: int, random: np.random.Generator) -> Scenario:
    """As ``wild`` (the same draws give the same robots and ways), with noise, dropouts and delay.

    Raises:
        Refusal: there are too few or too many robots.
    """
    return scenario_at(random.random(coordinates(robots, noisy=True)).tolist(), robots)


def scenario_at(point: Sequence[float], robots: int) -> Scenario:
    """The scenario at a point of the unit cube.

    Args:
        point: as many numbers in [0, 1] as ``coordinates`` says, with or without those of what is seen.
        robots: how many.
    """
    size, own_size = len(Shared._fields), len(Own._fields)
    shared = Shared(*point[:size])
    owns = [Own(*point[size + index * own_size :][:own_size]) for index in range(robots)]
    rest = point[size + robots * own_size :]
    step_s = round(_log(SHORTEST_STEP_S, LONGEST_STEP_S, shared.step), 3)
    radii_m = [_radius_m(shared, own) for own in owns]
    margin_m = round(max(LEAST_MARGIN_M, _log(0.2, 0.6, shared.margin) * sum(radii_m) / robots), 3)
    crew = _Crew(shared, owns, step_s, [radius_m + margin_m for radius_m in radii_m])
    ways = _placed(crew)
    drawn = [
        ScenarioRobot(
            id=str(index),
            start=_pose(start, way, own.start_heading),
            goal=_pose(goal, way, own.goal_heading),
            radius_m=radius_m,
            limits=limits,
        )
        for index, (own, radius_m, limits, way) in enumerate(
            zip(owns, radii_m, crew.limits, ways, strict=True), 1
        )
        for start, goal in [way]
    ]
    return Scenario(
        name=f"wild-{'noisy-' if rest else ''}{robots}",
        step_s=step_s,
        area=_area(ways, max(crew.bodies_m)),
        horizons=_horizons(shared, crew.limits, step_s),
        weights=_weights(shared),
        safety_margin_m=margin_m,
        time_limit_s=_time_limit_s(drawn, step_s),
        sensing=_sensing(Seen(*rest)) if rest else Sensing(),
        robots=drawn,
    )


class _Crew:
    """Limits of robots and their distances from the middle, which fit each other.

    Attributes:
        bodies_m: radii with the safety margin.
        limits: of each.
        starts, goals: of each robot, in polar coordinates around the middle: angle in rad, distance in m.
    """

    def __init__(self, shared: Shared, owns: Sequence[Own], step_s: float, bodies_m: Sequence[float]) -> None:
        self.bodies_m = bodies_m
        # Around the middle, each of the 2 n places takes the room of two bodies from the others at most.
        nearest_m = max(
            SHORTEST_M / (2.0 * math.cos(BEND_RAD / 2.0)), 4.0 * len(owns) * ROOM * max(bodies_m) / math.pi
        )
        furthest_m = LONGEST_M / 2.0
        usual_m = _log(nearest_m, furthest_m, shared.distance)
        slowest_mps = max(SLOWEST_MPS, 2.0 * usual_m / (WAY_STEPS * step_s))
        usual_mps = _log(slowest_mps, FASTEST_MPS, shared.speed)
        spread = 3.0**shared.speed_spread
        self.limits = [
            _limits(
                own,
                min(max(usual_mps * _log(1.0 / spread, spread, own.speed), slowest_mps), FASTEST_MPS),
                step_s,
            )
            for own in owns
        ]
        meeting_s = _time_s(usual_m, usual_mps, min(usual_mps, STRONGEST_MPS2))
        self.starts: list[Point] = []
        self.goals: list[Point] = []
        for own, limits in zip(owns, self.limits, strict=True):
            reach_m = _way_m(
                meeting_s * _between(0.8, 1.2, own.lead), limits.speed_mps, limits.acceleration_mps2
            )
            start_m = min(max(reach_m, nearest_m), furthest_m)
            goal_m = min(max(start_m * _between(0.7, 1.3, own.goal_distance), nearest_m), furthest_m)
            angle_rad = math.tau * own.direction
            self.starts.append((angle_rad, start_m))
            self.goals.append((angle_rad + math.pi + BEND_RAD * (2.0 * own.bend - 1.0) ** 3, goal_m))


def _placed(crew: _Crew) -> list[tuple[Point, Point]]:
    """Start and goal of each robot, of which no two are too near to each other, whoever's they are."""
    taken: list[Place] = []
    starts: list[Point] = []
    goals: list[Point] = []
    for wanted, places, others in ((crew.starts, starts, None), (crew.goals, goals, starts)):
        for index, (polar, body_m) in enumerate(zip(wanted, crew.bodies_m, strict=True)):
            own_start = [] if others is None else [others[index]]
            point = _nearest_free(polar, body_m, taken, own_start)
            taken.append((point, body_m))
            places.append(point)
    return list(zip(starts, goals, strict=True))


def _nearest_free(polar: Point, body_m: float, taken: Sequence[Place], own_start: Sequence[Point]) -> Point:
    """The place at an angle around the middle, else the nearest to either side, else one further out."""
    angle_rad, radius_m = polar
    while True:
        turn_rad = body_m / (4.0 * radius_m)
        for index in range(math.ceil(math.tau / turn_rad)):
            side = (index + 1) // 2 * (1 if index % 2 else -1)
            angle = angle_rad + side * turn_rad
            point = (round(radius_m * math.cos(angle), 3) + 0.0, round(radius_m * math.sin(angle), 3) + 0.0)
            is_free = all(math.dist(point, other) >= ROOM * (body_m + other_m) for other, other_m in taken)
            if is_free and all(SHORTEST_M <= math.dist(point, start) <= LONGEST_M for start in own_start):
                return point
        radius_m = min(1.1 * radius_m, LONGEST_M / 2.0)  # where the largest bodies find places for all


def _radius_m(shared: Shared, own: Own) -> float:
    spread = 3.0**shared.radius_spread
    usual_m = _log(SMALLEST_M, LARGEST_M, shared.radius)
    return round(min(max(usual_m * _log(1.0 / spread, spread, own.radius), SMALLEST_M), LARGEST_M), 3)


def _limits(own: Own, speed_mps: float, step_s: float) -> Limits:
    """Of a robot with this speed; its acceleration grows for a tenth to four tenths of the time to stop."""
    stop_s = _log(0.6, min(3.0, STOP_STEPS * step_s), own.stop)
    jerk_share = _between(0.1, 0.4, own.jerk)
    acceleration_mps2 = min(speed_mps / ((1.0 - jerk_share) * stop_s), STRONGEST_MPS2)
    return Limits(
        speed_mps=round(speed_mps, 3),
        acceleration_mps2=round(acceleration_mps2, 3),
        turn_rate_radps=round(_log(0.5, 2.0, own.turn_rate), 3),
        jerk_mps3=round(acceleration_mps2 / (jerk_share * stop_s), 3),
        turn_acceleration_radps2=round(_log(0.4, 2.0, own.turn_acceleration), 3),
    )


def _horizons(shared: Shared, limits: Sequence[Limits], step_s: float) -> Horizons:
    """Long enough to brake in, with a tenth to three quarters to spare."""
    stop_s = max(map(stopping_time_s, limits))
    steps = math.ceil(_between(1.1, 1.75, shared.horizon) * stop_s / step_s)
    return Horizons(
        prediction_steps=max(FEWEST_STEPS, steps), estimation_steps=round(_between(8.0, 20.0, shared.memory))
    )


def _weights(shared: Shared) -> Weights:
    usual = Weights()
    factor = 10.0 ** (WEIGHTS_DECADES * (shared.weights - 0.5))
    return Weights(
        x=_digits(factor * usual.x),
        y=_digits(factor * usual.y),
        heading=_digits(factor * usual.heading * _log(0.5, 2.0, shared.heading_weight)),
        speed=_digits(factor * usual.speed * _log(0.5, 2.0, shared.speed_weight)),
    )


def _area(ways: Sequence[tuple[Point, Point]], body_m: float) -> Area:
    """Around all places, with room to get out of each other's way."""
    furthest_m = max(abs(part) for way in ways for point in way for part in point)
    half_m = float(math.ceil(1.25 * furthest_m + 4.0 * body_m))
    return Area(x_min_m=-half_m, x_max_m=half_m, y_min_m=-half_m, y_max_m=half_m)


def _time_limit_s(robots: Sequence[ScenarioRobot], step_s: float) -> float:
    """Four times what the slowest robot needs alone and at least half a minute, within ``MOST_STEPS``."""
    needed_s = max(map(time_alone_s, robots))
    return float(math.floor(min(max(4.0 * needed_s, 30.0), MOST_STEPS * step_s)))


def time_alone_s(robot: ScenarioRobot) -> float:
    """What a robot needs at least if nobody else is there, in s: to drive its way, to stop, to turn."""
    limits = robot.limits
    way_m = math.dist((robot.start.x_m, robot.start.y_m), (robot.goal.x_m, robot.goal.y_m))
    driven_s = _time_s(way_m, limits.speed_mps, limits.acceleration_mps2) + stopping_time_s(limits) / 2.0
    along_rad = math.atan2(robot.goal.y_m - robot.start.y_m, robot.goal.x_m - robot.start.x_m)
    for heading_rad in (robot.start_state()[2], robot.goal_pose().heading_rad):
        turn_rad = abs(math.remainder(heading_rad - along_rad, math.tau))
        # At rest at both ends, so it is as long a way as with half the rate at each of them.
        driven_s += 2.0 * _time_s(turn_rad / 2.0, limits.turn_rate_radps, limits.turn_acceleration_radps2)
    return driven_s


def _time_s(way: float, rate: float, acceleration: float) -> float:
    """From rest over a way with a constant acceleration up to a rate."""
    ramp_s = rate / acceleration
    if way < rate * ramp_s / 2.0:
        return math.sqrt(2.0 * way / acceleration)
    return way / rate + ramp_s / 2.0


def _way_m(time_s: float, speed_mps: float, acceleration_mps2: float) -> float:
    """The way of which ``_time_s`` is the time."""
    ramp_s = speed_mps / acceleration_mps2
    if time_s < ramp_s:
        return acceleration_mps2 * time_s**2 / 2.0
    return speed_mps * (time_s - ramp_s / 2.0)


def _sensing(seen: Seen) -> Sensing:
    level = LEVELS[_one_of(len(LEVELS), seen.noise)]
    fields = [
        *([level] if level != AS_IN_THE_FILE else []),
        f"dropout={round(MOST_DROPOUT * seen.dropout, 3)}",
        f"delay_steps={_one_of(MOST_DELAY_STEPS + 1, seen.delay)}",
    ]
    return sensing_of("+".join(fields))


def _pose(point: Point, way: tuple[Point, Point], heading: float) -> Pose:
    """A place with the heading of the way, or one to either side of it, up to half a turn."""
    signed = 2.0 * heading - 1.0
    beyond = (abs(signed) - STRAIGHT) / (1.0 - STRAIGHT)
    if beyond <= 0.0:
        return Pose(x_m=point[0], y_m=point[1])
    (x_m, y_m), (goal_x_m, goal_y_m) = way
    along_rad = math.atan2(goal_y_m - y_m, goal_x_m - x_m)
    heading_rad = math.remainder(along_rad + math.copysign(math.pi * beyond, signed), math.tau)
    return Pose(x_m=point[0], y_m=point[1], heading_rad=round(heading_rad, 3) + 0.0)


def _between(low: float, high: float, share: float) -> float:
    return low + (high - low) * share


def _log(low: float, high: float, share: float) -> float:
    """As ``_between``, where a range spans decades."""
    return low * math.exp(share * math.log(high / low))


def _one_of(number: int, share: float) -> int:
    return min(int(number * share), number - 1)


def _digits(value: float) -> float:
    """With three digits, as a person would write it."""
    return float(f"{value:.3g}")
