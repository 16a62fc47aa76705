"""The bench's scenarios keep their promises, and what it records of closed loops is judged by other means."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fleet.bench.loops import (
    SPACING_M,
    Solved,
    TimedSolver,
    circle,
    cost,
    drive,
    passed_alike,
    random_crossing,
    shortfall_m,
)
from fleet.bench.measuring import MOST_ROBOTS, Distribution, Times, clocks_ms
from protocol.scenario import load_scenario
from scenarios import find
from world.vehicle import VehicleState
from world.vehicle import drive as driven_by_the_world

STEPS = 12
COUNTS = st.integers(1, MOST_ROBOTS)


def points(scenario):
    """Starts, then goals."""
    ways = [(robot.start, robot.goal) for robot in scenario.robots]
    return [[(pose.x_m, pose.y_m) for pose in poses] for poses in zip(*ways, strict=True)]


def are_spaced(places):
    return all(math.dist(one, other) >= SPACING_M for one, other in combinations(places, 2))


@given(COUNTS, st.integers(0, 2**32))
@example(MOST_ROBOTS, 0)
def test_random_crossings_are_spaced_on_the_border_of_one_square_and_repeatable(robots, seed):
    scenario = random_crossing(robots, seed)
    starts, goals = points(scenario)
    assert len(starts) == robots
    assert are_spaced(starts)
    assert are_spaced(goals)
    distances_m = [max(abs(x_m), abs(y_m)) for x_m, y_m in starts + goals]
    assert max(distances_m) <= 8.0
    assert distances_m == pytest.approx([distances_m[0]] * 2 * robots)
    assert scenario == random_crossing(robots, seed)
    assert [starts, goals] != points(random_crossing(robots, seed + 1))


def test_random_crossings_use_all_four_sides_for_starts_and_goals():
    for places in points(random_crossing(32, seed=0)):
        sides = {(abs(x) > abs(y), x > 0 if abs(x) > abs(y) else y > 0) for x, y in places}
        assert len(sides) == 4


@given(COUNTS)
def test_robots_on_a_circle_drive_through_its_middle(robots):
    starts, goals = points(circle(robots))
    assert len(starts) == robots
    assert goals == [(-x_m, -y_m) for x_m, y_m in starts]
    assert [math.hypot(*start) for start in starts] == pytest.approx([max(4.0, 0.28 * robots)] * robots)
    assert are_spaced(starts)


def test_times_are_percentiles_with_cpu_and_wall_apart():
    cpu_ms, wall_ms = np.random.default_rng(1).exponential(3.0, (2, 1234))
    times = Times.of(np.stack([cpu_ms, wall_ms], axis=1))
    assert times.count == 1234
    for found, values_ms in ((times.cpu, cpu_ms), (times.wall, wall_ms)):
        assert found == Distribution.of(values_ms)
        assert (found.median_ms, found.max_ms) == pytest.approx((np.median(values_ms), values_ms.max()))
        assert np.mean(values_ms > found.p90_ms) == pytest.approx(0.1, abs=1e-3)
        assert np.mean(values_ms > found.p99_ms) == pytest.approx(0.01, abs=1e-3)


def test_both_clocks_count_the_work_of_this_thread():
    begin_ms = clocks_ms()
    sum(range(100_000))
    assert (clocks_ms() - begin_ms > 0.0).all()


@pytest.fixture(scope="module")
def loop() -> Sequence[Solved]:
    return list(drive(load_scenario(find("2-crossing")), TimedSolver("realtime"), STEPS))


def states(loop):
    return np.array([solved.problem.states for solved in loop])


def test_robots_drive_the_first_inputs_of_each_solution(loop):
    for solved, following in pairwise(loop):
        for robot, limits in enumerate(solved.problem.limits):
            state = VehicleState(*solved.problem.states[robot])
            previous, wanted = solved.problem.previous_inputs[robot], solved.solution.inputs[robot, 0]
            reached, _, clipped = driven_by_the_world(limits, state, tuple(previous), tuple(wanted), 0.1)
            assert following.problem.states[robot] == pytest.approx(np.array(reached), abs=1e-9)
            assert not clipped


def test_only_the_first_solve_of_a_loop_is_cold_unless_a_start_is_given(loop):
    assert [solved.start.warm for solved in loop] == [False] + [True] * (STEPS - 1)
    start = loop[-1].solution.start(warm=False)
    (first,) = drive(load_scenario(find("2-crossing")), TimedSolver("realtime"), 1, start)
    np.testing.assert_array_equal(first.start.inputs, start.inputs)


def test_the_cost_of_a_loop_is_that_of_the_states_driven(loop):
    problem, driven = loop[0].problem, states(loop)
    error = driven[:, :, :2] - problem.goals[:, :2]
    by_hand = (error**2).sum() + 0.6 * (driven[:, :, 3] ** 2).sum()
    turned_rad = driven[:, :, 2] - problem.goals[:, 2]
    assert cost(loop) == pytest.approx(by_hand + 0.03 * (turned_rad**2).sum())


def test_the_shortfall_of_a_loop_is_that_of_the_closest_robots(loop):
    driven = states(loop)
    closest_m = np.linalg.norm(driven[:, 0, :2] - driven[:, 1, :2], axis=1).min()
    assert shortfall_m(loop) == pytest.approx(max(0.0, 1.39 - closest_m), abs=1e-9)
    scenario = load_scenario(find("2-crossing"))
    one, other = scenario.robots
    near = other.model_copy(update={"start": one.start.model_copy(update={"x_m": one.start.x_m + 1.2})})
    close = drive(scenario.model_copy(update={"robots": [one, near]}), TimedSolver("realtime"), 1)
    assert shortfall_m(list(close)) == pytest.approx(0.19)


def test_loops_are_alike_where_robots_pass_on_the_same_side_whatever_the_direction_at_their_end(loop):
    def turning(end_rad):
        """The second robot circles the first, from along x to this direction."""
        states = np.zeros((50, 2, 4))
        angles = np.linspace(0.0, end_rad, 50)
        states[:, 1, :2] = 2.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return [replace(loop[0], problem=replace(loop[0].problem, states=each)) for each in states]

    assert passed_alike(turning(np.pi - 0.1), turning(np.pi + 0.1))
    assert not passed_alike(turning(np.pi - 0.1), turning(-np.pi - 0.1))
