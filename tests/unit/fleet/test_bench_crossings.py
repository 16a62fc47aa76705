"""The bench's scenarios: what they promise holds for every number of robots."""

import math
from itertools import combinations

import pytest

from fleet.bench.loops import SPACING_M, circle, random_crossing
from fleet.bench.measuring import MOST_ROBOTS

COUNTS = [1, 2, 3, 8, 16, 31, MOST_ROBOTS]


def points(scenario):
    """Starts, then goals, as lists of points."""
    return [[(pose.x_m, pose.y_m) for pose in poses] for poses in zip(*ways(scenario), strict=True)]


def ways(scenario):
    return [(robot.start, robot.goal) for robot in scenario.robots]


@pytest.mark.parametrize("robots", COUNTS)
@pytest.mark.parametrize("seed", range(10))
def test_starts_and_goals_of_a_random_crossing_keep_their_spacing(robots, seed):
    scenario = random_crossing(robots, seed)
    assert len(scenario.robots) == robots
    for places in points(scenario):
        assert all(math.dist(one, other) >= SPACING_M for one, other in combinations(places, 2))


@pytest.mark.parametrize("robots", COUNTS)
def test_robots_of_a_random_crossing_begin_and_end_on_the_border_of_one_square(robots):
    starts, goals = points(random_crossing(robots, seed=3))
    distances_m = [max(abs(x_m), abs(y_m)) for x_m, y_m in starts + goals]
    assert max(distances_m) <= 8.0
    assert distances_m == pytest.approx([distances_m[0]] * 2 * robots)


def test_a_seed_gives_the_same_crossing_again_and_another_seed_another_one():
    assert random_crossing(8, seed=5) == random_crossing(8, seed=5)
    assert ways(random_crossing(8, seed=5)) != ways(random_crossing(8, seed=6))


def test_random_crossings_use_all_four_sides_for_starts_and_goals():
    for places in points(random_crossing(32, seed=0)):
        assert {(abs(x) > abs(y), x > 0 if abs(x) > abs(y) else y > 0) for x, y in places} == {
            (along_x, positive) for along_x in (True, False) for positive in (True, False)
        }


@pytest.mark.parametrize("robots", COUNTS)
def test_robots_on_a_circle_drive_through_its_middle(robots):
    scenario = circle(robots)
    assert len(scenario.robots) == robots
    for start, goal in ways(scenario):
        assert (goal.x_m, goal.y_m) == (-start.x_m, -start.y_m)
        assert math.hypot(start.x_m, start.y_m) == pytest.approx(max(4.0, 0.28 * robots))
    for places in points(scenario):
        assert all(math.dist(one, other) >= SPACING_M for one, other in combinations(places, 2))
