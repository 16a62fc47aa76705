"""The fit of the joint problem: its sensitivities, its arithmetic, and what it finds out about goals."""

from collections.abc import Iterator

import numpy as np
import pytest
from agent_helpers import STEP_S, remembered, scene_of
from goal_helpers import errors_m, followed
from hypothesis import given
from hypothesis import strategies as st
from realtime_helpers import closed_loop, data_of, random_crossing

from agent.estimate.joint_fit import LONGEST_M, SIGMAS, JointFit, gauss_newton
from agent.estimate.window import window_of
from agent.solve.problem import PRICE_PER_M
from agent.solve.realtime.kkt import Program
from agent.solve.realtime.profiles import pull_back, states_of
from agent.solve.realtime.qp import solve_program
from agent.solve.realtime.sensitivities import respond
from agent.solve.realtime.sequential import program_about
from agent.solve.vehicle import Array
from protocol.scene import Horizons

TIGHT = 1e-7


def programs(robots: int, seed: int) -> Iterator[Program]:
    for each in list(closed_loop(random_crossing(robots, seed), 14))[4::3]:
        start = each.starts[0]
        states = states_of(each.problem.states, start.inputs, STEP_S)
        yield program_about(data_of(each.problem), states, start.forces, PRICE_PER_M)


def solved(program: Program, gradients: Array) -> Array:
    limit_multipliers = np.zeros((2, *program.low.shape))
    outcome = solve_program(program._replace(gradients=gradients), limit_multipliers, TIGHT)
    assert outcome.solved
    return outcome.change


@pytest.mark.parametrize(("robots", "seed"), [(2, 0), (3, 1), (4, 2), (5, 3)])
def test_the_response_to_a_shifted_goal_is_that_of_finite_differences(robots, seed):
    errors = []
    for program in programs(robots, seed):
        outcome = solve_program(program, np.zeros((2, *program.low.shape)), TIGHT)
        for goal in range(2 * robots):
            pull = np.zeros((program.gradients.shape[1] // 2 + 1, 2))
            pull[:, goal % 2] = -program.weights[goal % 2]
            change = np.zeros_like(program.gradients)
            pull_back(program.jacobian[goal // 2], pull, change[goal // 2])
            there, back = (solved(program, program.gradients + side * 1e-3 * change) for side in (1.0, -1.0))
            expected = (there - back) / 2e-3
            errors.append(np.abs(respond(program, outcome, change) - expected).max() / np.abs(expected).max())
    # Where a limit begins or ceases to be tight between the two, differences show half of each.
    assert np.median(errors) < 0.06
    assert np.mean(np.array(errors) < 0.1) > 0.75


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 6))
def test_a_gauss_newton_step_solves_the_least_squares_problem(seed, robots, length):
    """Against numpy's least squares on the residuals written out."""
    random = np.random.default_rng(seed)
    by_goal = random.normal(size=(2 * robots, robots, length, 4))
    missing = 1e-2 * random.normal(size=(robots, length, 4)) * SIGMAS
    root = random.normal(size=(2 * robots, 2 * robots)) + 4.0 * np.eye(2 * robots)
    prior = random.normal(size=(robots, 2))
    found, covariance = gauss_newton(prior, root.T @ root, by_goal, missing)
    rows = np.concatenate([(by_goal / SIGMAS).reshape(2 * robots, -1).T, root])
    right = np.concatenate([(missing / SIGMAS).ravel(), np.zeros(2 * robots)])
    expected = np.linalg.lstsq(rows, right, rcond=None)[0]
    np.testing.assert_allclose(found - prior, expected.reshape(-1, 2), atol=1e-8)
    np.testing.assert_allclose(covariance, np.linalg.inv(rows.T @ rows), rtol=1e-6, atol=1e-9)


def test_a_goal_moves_no_further_at_once_than_derivatives_hold():
    by_goal = np.zeros((4, 2, 1, 4))
    by_goal[0, 0, 0, 0] = 1.0
    missing = np.zeros((2, 1, 4))
    missing[0, 0, 0] = 50.0
    found, _ = gauss_newton(np.zeros((2, 2)), 1e-3 * np.eye(4), by_goal, missing)
    np.testing.assert_allclose(found, [[LONGEST_M, 0.0], [0.0, 0.0]], atol=1e-9)


def test_a_robot_alone_is_understood_too():
    states, goals = followed(1, 5, 40)
    assert errors_m(JointFit(scene_of("0")), states, goals)[25:].max() < 0.5


def test_the_window_holds_what_was_seen_and_the_inputs_that_lead_through_it():
    """Of as many steps as both were seen."""
    states, _ = followed(2, 3, 17)
    memory = remembered({"a": states[:, 0], "b": states[-9:, 1]})
    window = window_of(memory, ["a", "b"], scene_of("ab"))
    assert (window.robots, window.step, window.states.shape) == (["a", "b"], 8, (2, 8, 4))
    np.testing.assert_allclose(window.begin, [states[-9, 0], states[-9, 1]])
    np.testing.assert_allclose(window.states[0], states[-8:, 0])
    driven = (states[1:, 0, 2:] - states[:-1, 0, 2:]) / STEP_S
    np.testing.assert_allclose(window.inputs[0], driven[-8:], atol=1e-9)
    np.testing.assert_allclose(window.before[0], driven[-9], atol=1e-9)
    assert window.before[1] == (0.0, 0.0), "before it was seen"


@pytest.mark.parametrize(("seen", "prediction_steps", "explained"), [(40, 30, 12), (40, 4, 4), (2, 30, None)])
def test_a_window_is_no_longer_than_what_was_seen_and_what_a_problem_goes_ahead(
    seen, prediction_steps, explained
):
    scene = scene_of("a", horizons=Horizons(prediction_steps=prediction_steps))
    window = window_of(remembered({"a": np.zeros((seen, 4))}), ["a"], scene)
    assert (window and window.states.shape[1]) == explained
