"""Families of scenarios: whatever the number of robots and the seed, they are valid and what they say."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chassis.refusal import Refusal
from fleet.inject.scenario import Scenario
from fleet.scenarios.suite import FAMILIES, FamilyName
from protocol.scenario import Pose, ScenarioRobot

MOST = {"perimeter": 16, "heterogeneous": 16}
"""The largest number of robots of a family, where it is less than that of a scenario."""


def drawn(family: FamilyName, robots: int, seed: int) -> Scenario:
    return FAMILIES[family](robots, np.random.default_rng(seed))


def for_any(*families: FamilyName):
    """Give a test a few scenarios of these families; most are small, some as large as can be."""

    @st.composite
    def scenarios(draw: st.DrawFn) -> Scenario:
        family = draw(st.sampled_from(families))
        robots = draw(st.integers(1, 12) | st.just(MOST.get(family, 128)))
        return drawn(family, robots, draw(st.integers(0, 2**32)))

    return lambda test: settings(max_examples=12 * len(families))(given(scenarios())(test))


def way_m(robot: ScenarioRobot) -> float:
    return math.dist((robot.start.x_m, robot.start.y_m), (robot.goal.x_m, robot.goal.y_m))


def sides(pose: Pose) -> set[str]:
    """Which sides of the publication's square a point lies on."""
    places = {"left": pose.x_m == -4, "right": pose.x_m == 4, "low": pose.y_m == -4, "high": pose.y_m == 4}
    return {side for side, there in places.items() if there}


@for_any(*FAMILIES)
def test_scenarios_are_valid_and_nobody_starts_or_parks_too_near_to_others_or_to_the_border(
    scenario: Scenario,
) -> None:
    ids = [robot.id for robot in scenario.robots]
    assert ids == [str(index + 1) for index in range(int(scenario.name.rpartition("-")[2]))]
    assert Scenario.model_validate(scenario.model_dump()) == scenario
    for one, other in combinations(scenario.robots, 2):
        safe_m = one.radius_m + other.radius_m + 0.4
        for a, b in ((one.start, other.start), (one.goal, other.goal)):
            assert math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) >= safe_m
    for robot in scenario.robots:
        for pose in (robot.start, robot.goal):
            assert scenario.area.x_min_m + 2 <= pose.x_m <= scenario.area.x_max_m - 2
            assert scenario.area.y_min_m + 1 <= pose.y_m <= scenario.area.y_max_m - 1
            assert (pose.x_m, pose.y_m) == (round(pose.x_m, 3), round(pose.y_m, 3))
        if not scenario.name.startswith("random"):
            assert way_m(robot) >= 8 - 0.002
            assert robot.start.heading_rad is robot.goal.heading_rad is None


@pytest.mark.parametrize("family", FAMILIES)
def test_a_seed_gives_one_scenario_and_another_seed_another(family: FamilyName) -> None:
    assert drawn(family, 5, 3) == drawn(family, 5, 3)
    assert len({str(drawn(family, 5, seed)) for seed in range(6)}) > 1


def test_a_robot_on_an_axis_heads_along_it_and_not_half_a_turn_the_other_way_round() -> None:
    class Unturned:
        def uniform(self, _low: float, _high: float) -> float:
            return 0.0

    headings = [robot.start_state()[2] for robot in FAMILIES["circle"](2, Unturned()).robots]
    assert [str(heading) for heading in headings] == [str(math.pi), "0.0"]


@for_any("perimeter", "heterogeneous")
def test_on_the_perimeter_everybody_drives_to_the_opposite_side(scenario: Scenario) -> None:
    opposite = {"left": "right", "right": "left", "low": "high", "high": "low"}
    for robot in scenario.robots:
        assert sides(robot.goal) & {opposite[side] for side in sides(robot.start)}
        for value in (robot.start.x_m, robot.start.y_m, robot.goal.x_m, robot.goal.y_m):
            assert value in (-4, -2, 0, 2, 4)


def test_every_point_of_the_perimeter_is_drawn_as_a_start_and_as_a_goal() -> None:
    robots = [robot for seed in range(120) for robot in drawn("perimeter", 2, seed).robots]
    for poses in ([robot.start for robot in robots], [robot.goal for robot in robots]):
        assert len({(pose.x_m, pose.y_m) for pose in poses}) == 16


@for_any("circle")
def test_on_a_circle_everybody_drives_through_its_middle_and_neighbours_are_equally_far_apart(
    scenario: Scenario,
) -> None:
    starts = [(robot.start.x_m, robot.start.y_m) for robot in scenario.robots]
    assert [(-robot.goal.x_m, -robot.goal.y_m) for robot in scenario.robots] == starts
    radius_m = math.hypot(*starts[0])
    assert [math.hypot(*start) for start in starts] == pytest.approx([radius_m] * len(starts), abs=0.002)
    around = [math.dist(one, other) for one, other in zip(starts, starts[1:] + starts[:1], strict=True)]
    assert around == pytest.approx([around[0]] * len(around), abs=0.003)


@for_any("corridor")
def test_in_a_corridor_two_equal_groups_change_sides_between_walls(scenario: Scenario) -> None:
    assert (scenario.area.y_min_m, scenario.area.y_max_m) == (-3, 3)
    eastward = [robot for robot in scenario.robots if robot.start.x_m < 0]
    assert len(eastward) - len(scenario.robots) / 2 in (0, 0.5)
    for robot in scenario.robots:
        assert min(abs(robot.start.x_m), abs(robot.goal.x_m)) >= 4
        assert (robot.start.x_m < 0) != (robot.goal.x_m < 0)
        assert {robot.start.y_m, robot.goal.y_m} <= {-2, 0, 2}
    for robots in (eastward, [robot for robot in scenario.robots if robot.start.x_m > 0]):
        in_front_first = sorted(robots, key=lambda robot: abs(robot.start.x_m))
        depths = [abs(robot.goal.x_m) for robot in in_front_first]
        assert depths == sorted(depths, reverse=True), "a parked robot stands in the way of those behind it"


@for_any("intersection")
def test_at_an_intersection_two_equal_streams_cross_at_a_right_angle(scenario: Scenario) -> None:
    robots = scenario.robots
    east = [r for r in robots if r.start.y_m == r.goal.y_m and r.start.x_m <= -4 and r.goal.x_m >= 4]
    north = [r for r in robots if r.start.x_m == r.goal.x_m and r.start.y_m <= -4 and r.goal.y_m >= 4]
    assert len(east) + len(north) == len(robots)
    assert len(east) - len(north) in (0, 1)
    assert {r.start.y_m for r in east} | {r.start.x_m for r in north} <= {-1, 1}
    for lane in (-1, 1):
        for stream in (
            [(r.start.x_m, r.goal.x_m) for r in east if r.start.y_m == lane],
            [(r.start.y_m, r.goal.y_m) for r in north if r.start.x_m == lane],
        ):
            goals_by_start = [goal for _, goal in sorted(stream)]
            assert goals_by_start == sorted(goals_by_start), "somebody has to overtake in a lane"


@for_any("random")
def test_at_random_positions_and_headings_are_free(scenario: Scenario) -> None:
    poses = [pose for robot in scenario.robots for pose in (robot.start, robot.goal)]
    half_m = max(4, 4 * math.sqrt(len(scenario.robots) / 8))
    for pose in poses:
        assert max(abs(pose.x_m), abs(pose.y_m)) <= half_m + 0.001
        assert pose.heading_rad is not None
        assert abs(pose.heading_rad) <= 3.15
    assert len({pose.heading_rad for pose in poses}) > 1


def test_heterogeneous_robots_differ_in_radius_and_in_every_limit() -> None:
    robots = drawn("heterogeneous", 8, 1).robots
    assert len({robot.radius_m for robot in robots}) > 4
    for limit in type(robots[0].limits).model_fields:
        assert len({getattr(robot.limits, limit) for robot in robots}) > 4


@pytest.mark.parametrize("family", MOST)
def test_more_robots_than_there_is_room_for_are_refused(family: FamilyName) -> None:
    with pytest.raises(Refusal, match="has room for 16 robots, not for 17"):
        drawn(family, 17, 0)
