"""What the bench records of closed loops, judged by other means."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fleet.bench.loops import Solved, TimedSolver, circle, cost, drive, passed_alike, shortfall_m
from fleet.bench.measuring import Distribution, Duration, Timer, Times
from protocol.scenario import load_scenario
from scenarios import find
from world.vehicle import VehicleState
from world.vehicle import drive as driven_by_the_world

STEPS = 12


@pytest.fixture(scope="module")
def loop() -> Sequence[Solved]:
    return list(drive(load_scenario(find("2-crossing")), TimedSolver("realtime"), STEPS))


def states(loop):
    return np.array([solved.problem.states for solved in loop])


def turned(loop, sides):
    """A start whose robots all drive in a bend to one side."""
    start = loop[0].starts[0]
    inputs = start.inputs.copy()
    inputs[:, :, 0] = np.array(sides)[:, None] * 0.4
    inputs[:, :15, 1] = 2.0
    return replace(start, inputs=inputs)


def test_distributions_are_those_of_numpy():
    values_ms = np.random.default_rng(1).exponential(3.0, 1234)
    found = Distribution.of(values_ms)
    assert found.median_ms == pytest.approx(np.median(values_ms))
    assert found.p90_ms == pytest.approx(np.percentile(values_ms, 90))
    assert found.p99_ms == pytest.approx(np.percentile(values_ms, 99))
    assert found.max_ms == values_ms.max()


def test_times_keep_cpu_and_wall_apart():
    times = Times.of([Duration(1.0, 10.0), Duration(3.0, 50.0), Duration(2.0, 20.0)])
    assert (times.count, times.cpu.median_ms, times.wall.median_ms) == (3, 2.0, 20.0)
    assert (times.cpu.max_ms, times.wall.max_ms) == (3.0, 50.0)


def test_a_timer_counts_the_work_of_its_thread_as_cpu_time():
    timer = Timer()
    before = timer.read()
    sum(range(100_000))
    after = timer.read()
    assert after.cpu_ms > before.cpu_ms > 0.0
    assert after.wall_ms > before.wall_ms > 0.0


def test_robots_drive_the_first_inputs_of_each_solution(loop):
    for solved, following in pairwise(loop):
        for robot, limits in enumerate(solved.problem.limits):
            state = VehicleState(*solved.problem.states[robot])
            previous, wanted = solved.problem.previous_inputs[robot], solved.solution.inputs[robot, 0]
            reached, _, clipped = driven_by_the_world(limits, state, tuple(previous), tuple(wanted), 0.1)
            assert following.problem.states[robot] == pytest.approx(np.array(reached), abs=1e-9)
            assert not clipped


def test_only_the_first_solve_of_a_loop_is_cold(loop):
    assert [solved.starts[0].warm for solved in loop] == [False] + [True] * (STEPS - 1)
    assert len(loop[0].starts) > 1


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


def test_the_shortfall_of_robots_that_begin_too_close_is_found():
    scenario = load_scenario(find("2-crossing"))
    one, other = scenario.robots
    near = other.model_copy(update={"start": one.start.model_copy(update={"x_m": one.start.x_m + 1.2})})
    loop = list(drive(scenario.model_copy(update={"robots": [one, near]}), TimedSolver("realtime"), 1))
    assert shortfall_m(loop) == pytest.approx(0.19)


def test_loops_that_pass_on_the_same_side_are_alike_and_mirrored_ones_are_not():
    scenario, solver = circle(2), TimedSolver("realtime")
    cold = list(drive(scenario, solver, 1))
    left, right = (
        list(drive(scenario, solver, 60, turned(cold, sides))) for sides in ((1.0, 1.0), (-1.0, -1.0))
    )
    assert cost(left) == pytest.approx(cost(right), rel=1e-6)
    assert passed_alike(left, left)
    assert not passed_alike(left, right)


def test_loops_are_alike_whatever_the_direction_in_which_their_lines_end(loop):
    def turning(end_rad):
        """The second robot circles the first, from along x to this direction."""
        states = np.zeros((50, 2, 4))
        angles = np.linspace(0.0, end_rad, 50)
        states[:, 1, :2] = 2.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return [replace(loop[0], problem=replace(loop[0].problem, states=each)) for each in states]

    assert passed_alike(turning(np.pi - 0.1), turning(np.pi + 0.1))
    assert not passed_alike(turning(np.pi - 0.1), turning(-np.pi - 0.1))


def test_a_loop_begins_where_it_is_told_to(loop):
    start = loop[-1].solution.start(warm=False)
    (first,) = drive(load_scenario(find("2-crossing")), TimedSolver("realtime"), 1, start)
    assert first.starts == [start]
