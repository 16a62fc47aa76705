"""The reserve: what its proof in docs/safety.md rests on, shown with the world's own vehicles."""

import math
from collections.abc import Iterable, Mapping
from copy import deepcopy
from itertools import combinations
from typing import NamedTuple

import numpy as np
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from agent.drive.reserve import (
    CERTAIN,
    CHOICES,
    EXCUSED,
    SIGMAS,
    Reserve,
    braking_path,
    braking_steps,
    contingency,
    largest_rectangle,
    parted,
)
from agent.remember.memory import Memory
from agent.solve.vehicle import Array
from protocol.messages import Accuracy, Command
from protocol.scene import PublicRobot, Scene
from protocol.vehicle import Input, Limits, braking_input, reachable_inputs
from world.vehicle import Vehicle, VehicleState

EXACT = Accuracy()
LOW = Accuracy(position_m=0.02, heading_rad=0.035, speed_mps=0.05)
ROUNDING = 1e-7
"""In m; a line lets positions of some metres pass by 1e-9 of them, and steps add up."""
SHARES = st.floats(-1.0, 1.0, allow_subnormal=False) | st.sampled_from([-1.0, 0.0, 1.0])


@st.composite
def limits_of(draw: st.DrawFn) -> Limits:
    """From a crawler to a courier: how long they take to stop, to ramp and to turn differs too."""
    speed, stop, ramp = draw(st.floats(0.2, 6.0)), draw(st.floats(0.4, 3.0)), draw(st.floats(0.1, 1.0))
    turn, swing = draw(st.floats(0.2, 3.0)), draw(st.floats(0.2, 4.0))
    return Limits(
        speed_mps=speed,
        acceleration_mps2=speed / stop,
        jerk_mps3=speed / stop / ramp,
        turn_rate_radps=turn,
        turn_acceleration_radps2=turn / swing,
    )


STEPS_S = st.sampled_from([0.05, 0.1, 0.2])


@st.composite
def vehicles(draw: st.DrawFn, count: int = 1) -> list[Vehicle]:
    """At one place, in any motion; at a standstill and at the limits, too."""
    step_s = draw(STEPS_S)
    found = []
    for _ in range(count):
        limits = draw(limits_of())
        applied = Input(
            draw(SHARES) * limits.turn_rate_radps,
            draw(SHARES) * limits.acceleration_mps2,
        )
        state = VehicleState(0.0, 0.0, draw(st.floats(-math.pi, math.pi)), draw(SHARES) * limits.speed_mps)
        found.append(Vehicle(limits, step_s, state, applied))
    return found


def braked(vehicle: Vehicle, steps: int) -> Array:
    """Positions (n, 2) of a vehicle without commands, by the world."""
    vehicle, path = deepcopy(vehicle), [vehicle.state[:2]]
    for _ in range(steps):
        vehicle.obey(None)
        path.append(vehicle.state[:2])
    return np.array(path)


def obey(vehicle: Vehicle, wanted: Input) -> None:
    """Drive a step by a command."""
    turn_rate, acceleration = wanted
    command = Command(epoch=0, robot="a", step=0, turn_rate_radps=turn_rate, acceleration_mps2=acceleration)
    vehicle.obey(command)


def before(vehicle: Vehicle) -> VehicleState:
    """The state a step ago."""
    x, y, heading, speed = vehicle.state
    (turn_rate, acceleration), step_s = vehicle.applied, vehicle.step_s
    heading, speed = heading - step_s * turn_rate, speed - step_s * acceleration
    way = step_s * speed
    return VehicleState(x - way * math.cos(heading), y - way * math.sin(heading), heading, speed)


class Robot(NamedTuple):
    """What a robot has of its own."""

    memory: Memory
    reserve: Reserve


class Company:
    """Some robots, each with a view and a reserve of its own."""

    def __init__(self, bodies: Mapping[str, Vehicle], radii_m: Iterable[float], margin_m: float) -> None:
        self.bodies = dict(bodies)
        self.step = 1
        [self.step_s] = {vehicle.step_s for vehicle in bodies.values()}
        robots = {
            name: PublicRobot(limits=vehicle.limits, radius_m=radius_m)
            for (name, vehicle), radius_m in zip(bodies.items(), radii_m, strict=True)
        }
        self.scene = Scene(robots=robots, step_s=self.step_s, safety_margin_m=margin_m)
        self.steps = max(braking_steps(vehicle.limits, self.step_s) for vehicle in bodies.values()) + 1
        self.robots = {}
        for name in bodies:
            memory = Memory(17, self.step_s, owner=name, limits_of=lambda each: self.scene.robot(each).limits)
            memory.remember(0, {each: before(vehicle) for each, vehicle in bodies.items()})
            self.robots[name] = Robot(memory, Reserve(self.scene, name))

    def least_m(self, one: str, other: str) -> float:
        return self.scene.collision_distance_m(one, other) + CERTAIN * self.scene.safety_margin_m

    def part(self, angles: Iterable[float], more: float) -> None:
        """Move each away from those before it, in a direction, until all contingencies are apart.

        Args:
            angles: of these directions, in rad.
            more: by what part of the distance they are then further apart than needed.
        """
        names = list(self.bodies)
        for index, (name, angle) in enumerate(zip(names, angles, strict=True)):
            path, direction = (
                braked(self.bodies[name], self.steps),
                np.array([math.cos(angle), math.sin(angle)]),
            )
            way_m = 0.0
            for other in names[:index]:
                between, least_m = path - braked(self.bodies[other], self.steps), self.least_m(name, other)
                least_m *= 1.0 + more
                along = between @ direction
                aside = (between**2).sum(axis=1) - along**2
                ends = np.sqrt(np.maximum(least_m**2 - aside, 0.0)) - along
                way_m = max(way_m, float(ends[aside < least_m**2].max(initial=0.0)))
            state = self.bodies[name].state
            x_m, y_m = np.array(state[:2]) + way_m * direction
            self.bodies[name].state = state._replace(x_m=float(x_m), y_m=float(y_m))
        for memory, _ in self.robots.values():
            memory.step = -1
            for name in names:
                memory.forget(name)
            memory.remember(0, {name: before(vehicle) for name, vehicle in self.bodies.items()})

    def look(self, unseen: Iterable[str] = (), accuracy: Accuracy = EXACT) -> None:
        """Everybody sees everybody, but for those that nobody else sees, and draws lines."""
        for name, (memory, reserve) in self.robots.items():
            seen = {
                each: vehicle.state
                for each, vehicle in self.bodies.items()
                if each == name or each not in unseen
            }
            memory.remember(self.step, seen)
            reserve.update(memory, self.bodies[name].applied, accuracy)

    def chosen(self, name: str, rng: np.random.Generator) -> Input:
        """Some input that the robot's lines allow: it wants anything that it can reach."""
        vehicle, (memory, reserve) = self.bodies[name], self.robots[name]
        lowest, highest = reachable_inputs(vehicle.limits, vehicle.applied, vehicle.step_s)
        share = np.clip(rng.uniform(-0.5, 1.5, 2), 0.0, 1.0)
        wanted = Input(*(np.array(lowest) + share * (np.array(highest) - np.array(lowest))).tolist())
        return reserve.nearest_allowed(memory, wanted, vehicle.applied)

    def drive(self, inputs: Mapping[str, Input]) -> None:
        for name, wanted in inputs.items():
            obey(self.bodies[name], wanted)
        self.step += 1

    def short_m(self) -> float:
        """By how much the contingencies of a pair are nearer than the distance, at most."""
        paths = {name: braked(vehicle, self.steps) for name, vehicle in self.bodies.items()}
        return max(
            self.least_m(one, other) - float(np.linalg.norm(paths[one] - paths[other], axis=1).min())
            for one, other in combinations(paths, 2)
        )


@st.composite
def companies(draw: st.DrawFn, count: int) -> Company:
    """Robots whose contingencies are just apart, or a little more."""
    bodies = dict(zip("abc", draw(vehicles(count)), strict=False))
    radii_m, margin_m = [draw(st.floats(0.1, 1.0)) for _ in bodies], draw(st.floats(0.0, 0.4))
    company = Company(bodies, radii_m, margin_m)
    angles = [draw(st.floats(-math.pi, math.pi)) for _ in bodies]
    company.part(angles, draw(st.sampled_from([1e-9, 0.01, 0.3, 1.0])))
    return company


@given(vehicles())
def test_a_contingency_is_how_the_world_brakes_and_ends_standing(bodies):
    [vehicle] = bodies
    limits, step_s, steps = vehicle.limits, vehicle.step_s, braking_steps(vehicle.limits, vehicle.step_s)
    expected = braked(vehicle, steps + 1)
    rates = limits.turn_acceleration_radps2 * step_s, limits.jerk_mps3 * step_s
    told = np.array([limits.speed_mps, limits.turn_rate_radps, limits.acceleration_mps2, *rates])
    path, state = np.empty((steps + 2, 2)), np.array(vehicle.state)
    contingency(state, np.array(vehicle.applied), told, step_s, 0, path)
    np.testing.assert_allclose(path, expected, rtol=0, atol=1e-9)
    assert math.dist(expected[-1], expected[-2]) < 1e-9, "it has come to a stand by then"
    short = braking_path(state, vehicle.applied, limits, step_s)
    np.testing.assert_array_equal(short, path[: len(short)])
    np.testing.assert_allclose(path[len(short) :], np.tile(short[-1], (len(path) - len(short), 1)), atol=1e-7)
    # To brake by a command is the same.
    contingency(
        state, np.array(braking_input(limits, vehicle.applied, state[3], step_s)), told, step_s, 1, path
    )
    np.testing.assert_allclose(path, expected, rtol=0, atol=1e-9)


def stretch(vehicle: Vehicle, steps: int) -> tuple[Array, Array]:
    """Positions if a vehicle brakes at once, and if it goes on for one more step, by the world."""
    later = deepcopy(vehicle)
    obey(later, vehicle.applied)
    return braked(vehicle, steps), np.concatenate([[vehicle.state[:2]], braked(later, steps - 1)])


def beyond_m(vehicle: Vehicle, normal: Array, side_m: Array) -> float:
    """By how much the contingency of a vehicle after a step is beyond the lines drawn before it."""
    along = (normal[1:] * braked(vehicle, len(normal) - 2)).sum(axis=1)
    return float((side_m[1:] - along).max())


@settings(max_examples=40)
@given(st.integers(2, 3).flatmap(companies), st.integers(0, 2**32 - 1))
def test_robots_that_each_keep_to_their_own_lines_can_always_brake_clear_of_each_other(company, seed):
    """The theorem: whatever else they do, unequal ones too, each by its own view; and nobody is doubted."""
    rng = np.random.default_rng(seed)
    assert company.short_m() < ROUNDING
    for _ in range(12):
        company.look()
        assert not any(reserve.doubted(memory) for memory, reserve in company.robots.values())
        company.drive({name: company.chosen(name, rng) for name in company.bodies})
        assert company.short_m() < ROUNDING


@given(vehicles(2), st.just(0.0) | st.floats(1e-3, 5.0), st.floats(-math.pi, math.pi), st.floats(0.1, 2.0))
@example(
    [Vehicle(Limits(), 0.1, VehicleState(0.0, 0.0, turn, 2.0)) for turn in (0.0, math.pi)], 3.0, 0.0, 1.0
)
@example([Vehicle(Limits(), 0.1, VehicleState(0.0, 0.0, 0.0, 1.0)) for _ in range(2)], 0.0, 0.0, 1.0)
def test_both_draw_the_same_lines_and_braking_keeps_to_them_wherever_they_are(bodies, away_m, angle, least_m):
    """Also where contingencies meet: then neither is to come nearer still."""
    one, other = bodies
    x_m, y_m = away_m * math.cos(angle), away_m * math.sin(angle)
    other.state = other.state._replace(x_m=x_m, y_m=y_m)
    steps = max(braking_steps(vehicle.limits, vehicle.step_s) for vehicle in bodies) + 1
    here, there, kept_m = stretch(one, steps), stretch(other, steps), np.full(steps + 1, least_m)
    mine, its = parted(*here, *there, kept_m, True), parted(*there, *here, kept_m, True)
    for lines, path in ((mine, here[0]), (its, there[0])):
        assert ((lines.normal * path).sum(axis=1) >= lines.own - ROUNDING).all()
        if away_m > 0.0:
            np.testing.assert_allclose(np.linalg.norm(lines.normal, axis=1), 1.0)
    apart_m = np.linalg.norm(here[0] - there[0], axis=1)
    assert (mine.own - mine.other >= np.minimum(apart_m, least_m) - ROUNDING).all()
    clear = (apart_m > 1e-3) | (apart_m == 0.0)  # in between, rounding turns the line
    np.testing.assert_allclose(mine.normal[clear], -its.normal[clear], atol=ROUNDING)
    np.testing.assert_allclose(mine.own[clear], -its.other[clear], atol=ROUNDING)
    np.testing.assert_allclose(mine.other[clear], -its.own[clear], atol=ROUNDING)


@settings(max_examples=50)
@given(companies(2), st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)))
def test_what_is_wanted_is_driven_where_allowed_and_else_something_that_is(company, shares):
    company.look()
    (vehicle, other), (memory, reserve) = company.bodies.values(), company.robots["a"]
    lowest, highest = map(np.array, reachable_inputs(vehicle.limits, vehicle.applied, vehicle.step_s))
    wanted = Input(*(lowest + np.array(shares) * (highest - lowest)).tolist())
    kept_m = np.full(company.steps + 1, company.least_m("a", "b"))
    normal, own, _ = parted(*stretch(vehicle, company.steps), *stretch(other, company.steps), kept_m, True)

    def beyond(driven: Input) -> float:
        after = deepcopy(vehicle)
        obey(after, driven)
        return beyond_m(after, normal, own)

    found = reserve.nearest_allowed(memory, wanted, vehicle.applied)
    assert beyond(found) < ROUNDING
    assert (lowest - 1e-12 <= found).all()
    assert (found <= highest + 1e-12).all()
    if beyond(wanted) < -ROUNDING:
        assert found == wanted
    if beyond(wanted) > ROUNDING:
        assert found != wanted


def away_m(points: Array, begin: Array, end: Array) -> Array:
    """Distances (n,) of points from stretches, all (n, 2)."""
    way = end - begin
    length = np.maximum((way**2).sum(axis=1), 1e-300)
    share = np.clip(((points - begin) * way).sum(axis=1) / length, 0.0, 1.0)
    found: Array = np.linalg.norm(points - begin - share[:, None] * way, axis=1)
    return found


@settings(max_examples=40)
@given(companies(2), st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_who_is_not_seen_may_have_gone_on_or_begun_to_brake_at_any_time(company, unseen, seed):
    """No step brings a robot nearer to it than allowed, whenever that was: in a turn, too."""
    rng, seen = np.random.default_rng(seed), company.bodies["b"]
    company.look()
    for _ in range(unseen):
        company.drive({"a": company.chosen("a", rng)})
        company.look(unseen="b")
    ways = []
    for going_on in range(unseen + 2):
        vehicle = deepcopy(seen)
        path = [vehicle.state[:2]]
        for _ in range(going_on):
            obey(vehicle, seen.applied)
            path.append(vehicle.state[:2])
        path += braked(vehicle, company.steps + unseen)[1:].tolist()
        ways.append(np.array(path)[unseen : unseen + company.steps + 1])
    turned_m = np.max([away_m(way, ways[0], ways[-1]) for way in ways], axis=0)
    clear_m = away_m(braked(company.bodies["a"], company.steps), ways[0], ways[-1]) - turned_m
    allowed_m = np.minimum(clear_m, company.least_m("a", "b"))
    company.drive({"a": company.chosen("a", rng)})
    after = braked(company.bodies["a"], company.steps - 1)
    for way in ways:
        assert (np.linalg.norm(after - way[1:], axis=1) >= allowed_m[1:] - ROUNDING).all()


@settings(max_examples=15)
@given(companies(2), st.integers(0, 2**32 - 1), st.sampled_from([EXACT, LOW]))
def test_who_crosses_a_line_is_doubted_until_it_could_stand_and_nobody_else_is(company, seed, accuracy):
    """By more than it is excused, and than noise of 3 σ moves its contingency."""
    rng = np.random.default_rng(seed)
    (vehicle, other), (memory, reserve) = company.bodies.values(), company.robots["a"]
    kept_m, steps, crossed = np.full(company.steps + 1, company.least_m("a", "b")), company.steps, -math.inf
    for _ in range(15):
        company.look(accuracy=accuracy)
        assert ("b" in reserve.doubted(memory)) == (company.step - crossed <= steps - 1)
        normal, _, side_m = parted(*stretch(vehicle, steps), *stretch(other, steps), kept_m, True)
        company.drive({"a": company.chosen("a", rng)})
        lowest, highest = reachable_inputs(other.limits, other.applied, other.step_s)
        obey(other, Input(*rng.choice([lowest, highest], axis=0).tolist()))
        path = braked(other, steps)
        turned_m = math.dist(path[0], path[-1]) * accuracy.heading_rad
        noise_m = accuracy.position_m + turned_m + (steps - 1) * other.step_s * accuracy.speed_mps
        over_m = beyond_m(other, -normal, -side_m)
        over_m -= EXCUSED * company.scene.safety_margin_m + SIGMAS * noise_m
        assume(abs(over_m) > ROUNDING)
        if over_m > 0.0:
            crossed = company.step


@given(companies(2), st.tuples(SHARES, SHARES))
def test_the_room_for_a_plan_is_within_the_lines_and_only_told_where_it_is_needed(company, shares):
    """Of what a robot wants, it is None where that is allowed; where nothing is, it is braking."""
    company.look()
    for name, (memory, reserve) in company.robots.items():
        vehicle = company.bodies[name]
        lowest, highest = map(np.array, reachable_inputs(vehicle.limits, vehicle.applied, vehicle.step_s))
        wanted = Input(*(lowest + (0.5 + 0.5 * np.array(shares)) * (highest - lowest)).tolist())
        nearest = reserve.nearest_allowed(memory, wanted, vehicle.applied)
        room = reserve.room(memory, wanted, vehicle.applied)
        assert (room is None) == (nearest == wanted)
        if room is None:
            continue
        braking = braking_input(vehicle.limits, vehicle.applied, vehicle.state.speed_mps, vehicle.step_s)
        if room.lowest == room.highest == braking:
            continue
        values = np.linspace(lowest, highest, CHOICES)
        inside = [
            Input(turn_rate, acceleration)
            for turn_rate in values[:, 0].tolist()
            for acceleration in values[:, 1].tolist()
            if room.clip(Input(turn_rate, acceleration)) == (turn_rate, acceleration)
        ]
        assert inside
        for each in inside:
            assert reserve.nearest_allowed(memory, each, vehicle.applied) == each


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.95))
def test_no_rectangle_of_allowed_inputs_around_the_nearest_one_is_larger(seed, share):
    random = np.random.default_rng(seed)
    allowed = random.random((6, 6)) < share
    assume(allowed.any())
    row, column = random.permutation(np.argwhere(allowed))[0].tolist()
    (top, bottom), (left, right) = largest_rectangle(allowed, row, column)
    assert allowed[top : bottom + 1, left : right + 1].all()
    assert top <= row <= bottom
    assert left <= column <= right
    sizes = [
        (b + 1 - t) * (last + 1 - first)
        for t in range(row + 1)
        for b in range(row, 6)
        for first in range(column + 1)
        for last in range(column, 6)
        if allowed[t : b + 1, first : last + 1].all()
    ]
    assert (bottom + 1 - top) * (right + 1 - left) == max(sizes)
