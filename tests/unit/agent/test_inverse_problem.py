"""Eq. 6 as it is written down: constraints and their derivatives beside an independent set-up."""

import numpy as np
import pytest
from agent_helpers import STEP_S, remembered, scene_of
from inverse_drives import STEPS, crossing, passing
from inverse_oracle import dense_problem

from agent.estimate.inverse_problem import (
    FIRST_DISTANCE,
    InverseProblem,
    InverseProblems,
    add_loads,
    slopes,
    stage_costs,
)
from agent.estimate.linear_quadratic import (
    COORDINATES,
    INPUT,
    QUANTITIES,
    advance,
    drive_through,
    empty_stage_costs,
    quantities,
)
from agent.solve.vehicle import rollout

SCENE = scene_of("abcd")
NO_WEIGHT = np.zeros(3)


def problem_of(tracks: dict[str, np.ndarray], robot: str = "a") -> InverseProblem:
    return InverseProblems(scene_of(tracks)).of(remembered(tracks))[robot]


def coordinates_of(problem: InverseProblem, change: np.ndarray) -> np.ndarray:
    """The coordinates of all stages (K + 1, 11) that a change (K, 2) of the inputs leads to."""
    drive = drive_through(problem.states, problem.step_s, problem.weights, NO_WEIGHT)
    result = np.zeros((len(change) + 1, COORDINATES))
    for k, each in enumerate(change):
        result[k, INPUT:] = each
        advance(drive.motion[k], drive.step_s, result[k], result[k + 1])
    return result


def slopes_of(problem: InverseProblem, change: np.ndarray) -> np.ndarray:
    result = np.empty_like(problem.values)
    slopes(problem, coordinates_of(problem, change), result)
    return result


@pytest.mark.parametrize("tracks", [passing(0), passing(1), crossing(1)])
def test_constraints_are_those_of_an_independent_set_up(tracks):
    expected = dense_problem(scene_of(tracks), tracks, "a").values
    np.testing.assert_allclose(problem_of(tracks).values, expected, atol=1e-9)


@pytest.mark.parametrize("tracks", [passing(0), passing(1), crossing(1)])
def test_slopes_are_the_derivatives_that_casadi_finds(tracks):
    gradients = dense_problem(scene_of(tracks), tracks, "a").gradients
    problem = problem_of(tracks)
    for unit in np.eye(2 * STEPS):
        np.testing.assert_allclose(slopes_of(problem, unit.reshape(STEPS, 2)), gradients @ unit, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_slopes_agree_with_central_differences_of_the_constraints(seed):
    """The inputs of the window change; what was before it stays."""
    tracks, size = passing(seed), 1e-6
    change = np.random.default_rng(seed).normal(size=(STEPS, 2))
    inputs = np.diff(tracks["a"][1:, 2:], axis=0) / STEP_S

    def moved(by: float) -> np.ndarray:
        states = rollout(tracks["a"][1], inputs + by * change, STEP_S)
        return problem_of(tracks | {"a": np.concatenate([tracks["a"][:1], states])}).values

    difference = (moved(size) - moved(-size)) / (2 * size)
    np.testing.assert_allclose(slopes_of(problem_of(tracks), change), difference, atol=1e-6)


def test_loads_are_the_transpose_of_slopes():
    problem, random = problem_of(passing(2)), np.random.default_rng(2)
    coordinates = random.normal(size=(STEPS + 1, COORDINATES))
    multipliers = random.normal(size=problem.values.shape)
    change, loads = np.empty_like(multipliers), np.zeros((STEPS, COORDINATES))
    slopes(problem, coordinates, change)
    add_loads(problem, multipliers, loads)
    assert (loads * coordinates[:-1]).sum() == pytest.approx((multipliers * change).sum())


def test_stage_costs_are_the_wanted_squares_of_slopes():
    problem, random = problem_of(passing(3)), np.random.default_rng(3)
    compliances, couplings = random.random(problem.values.shape), random.random(STEPS)
    coordinates = random.normal(size=(STEPS + 1, COORDINATES))
    change, costs = np.empty_like(compliances), empty_stage_costs(STEPS)
    slopes(problem, coordinates, change)
    stage_costs(problem, compliances, couplings, costs)
    for k in range(STEPS):
        q = np.empty(QUANTITIES)
        quantities(coordinates[k], STEP_S, q)
        found = costs.squares[k] @ q**2 + 2 * costs.product[k] * q[0] * q[1] - (costs.rank_one[k] @ q) ** 2
        mixed = (compliances[k] * problem.values[k]) @ change[k]
        assert found == pytest.approx(compliances[k] @ change[k] ** 2 - couplings[k] * mixed**2)


def test_a_robot_seen_later_counts_only_where_it_was_seen():
    problem = problem_of(passing(7))
    unseen = {"b": 0, "c": STEPS + 1 - 9, "d": STEPS}
    for column, stages in enumerate(unseen.values()):
        values, bearings = problem.values[:, FIRST_DISTANCE + column], problem.bearings[:, column]
        assert not values[:stages].any()
        assert not bearings[:stages].any()
        assert values[stages:].all()
        np.testing.assert_allclose(np.linalg.norm(bearings[stages:], axis=1), 1.0)


def test_rates_at_the_first_stage_need_the_state_before_else_the_input_before_is_zero():
    tracks = {robot: track for robot, track in passing(5).items() if robot in "ab"}
    without = {robot: track[1:] for robot, track in tracks.items()}
    inputs = np.diff(tracks["a"][:3, 2:], axis=0) / STEP_S
    limits = SCENE.robot("a").limits
    for given, before in ((tracks, inputs[0]), (without, np.zeros(2))):
        rates = (inputs[1] - before) / STEP_S
        bounds = [limits.turn_acceleration_radps2, limits.jerk_mps3]
        expected = np.column_stack([rates - bounds, -rates - bounds]).ravel()
        np.testing.assert_allclose(problem_of(given).values[0, 10:14], expected, atol=1e-9)


def test_only_robots_seen_for_the_whole_window_have_a_problem():
    tracks = passing(8)
    assert set(InverseProblems(SCENE).of(remembered(tracks))) == {"a", "b"}
    assert set(InverseProblems(SCENE).of(remembered(tracks | {"c": tracks["a"][1:]}))) == {"a", "b", "c"}


def test_robots_that_come_and_go_change_the_rows_of_the_next_problem():
    """One object writes them all: distances and limits are those of the robots present."""
    problems = InverseProblems(SCENE)
    for company in ("abcd", "a", "ab", "abcd", "abd"):
        tracks = {robot: track for robot, track in passing(9).items() if robot in company}
        found, alone = (each.of(remembered(tracks))["a"] for each in (problems, InverseProblems(SCENE)))
        np.testing.assert_array_equal(found.values, alone.values)
        assert found.values.shape == (STEPS, FIRST_DISTANCE + len(company) - 1)
