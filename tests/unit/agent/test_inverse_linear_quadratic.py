"""The Riccati recursion beside dense linear algebra, and the linearised drive beside the rollout."""

import numpy as np
import pytest
from agent_helpers import STEP_S, WEIGHTS, euler
from inverse_drives import drive

from agent.estimate.inverse_problem import NEARNESS
from agent.estimate.linear_quadratic import (
    BEFORE,
    COORDINATES,
    GOAL,
    INPUT,
    P_X,
    QUANTITIES,
    SPEED,
    Drive,
    StageCosts,
    add_quantities,
    advance,
    drive_through,
    factorise,
    pull_back,
    quantities,
    solve,
)
from agent.solve.vehicle import recovered_inputs, rollout

STATE = slice(P_X, SPEED + 1)


def some_drive(stages: int, seed: int) -> tuple[np.ndarray, Drive]:
    states = drive(np.random.default_rng(seed), (-1.0, 2.0, 0.7, 1.5), stages + 1)
    return states, drive_through(states, STEP_S, np.array(WEIGHTS), NEARNESS)


def coordinates_by_differences(states: np.ndarray, size: float = 1e-5) -> np.ndarray:
    """How the coordinates of each stage but L change with each input, shape (K + 1, 11, 2K)."""
    stages = len(states) - 1
    inputs = recovered_inputs(states, STEP_S)
    result = np.zeros((stages + 1, COORDINATES, 2 * stages))
    for column, unit in enumerate(np.eye(2 * stages).reshape(-1, stages, 2)):
        above, below = (rollout(states[0], inputs + sign * size * unit, STEP_S) for sign in (1, -1))
        result[:, STATE, column] = (above - below) / (2 * size)
        result[1:, BEFORE:INPUT, column] = unit
        result[:-1, INPUT:, column] = unit
    return result


def quantity_matrix() -> np.ndarray:
    """What ``quantities`` does, shape (7, 11)."""
    result = np.zeros((QUANTITIES, COORDINATES))
    for column, unit in enumerate(np.eye(COORDINATES)):
        out = np.empty(QUANTITIES)
        quantities(unit, STEP_S, out)
        result[:, column] = out
    return result


def test_coordinates_that_advance_are_the_derivatives_of_the_rollout():
    states, linear = some_drive(15, 1)
    expected = coordinates_by_differences(states)
    for column, unit in enumerate(np.eye(30).reshape(-1, 15, 2)):
        now = np.zeros((16, COORDINATES))
        for k in range(15):
            now[k, INPUT:] = unit[k]
            advance(linear.motion[k], STEP_S, now[k], now[k + 1])
        np.testing.assert_allclose(now, expected[:, :, column], atol=1e-8)


def test_turning_moves_observed_positions_around_where_it_begins_and_accelerating_along_the_way():
    """Also where states are noisy, so that positions do not follow from speeds and headings."""
    states, _ = some_drive(15, 3)
    states += np.random.default_rng(3).normal(scale=0.05, size=states.shape)
    linear = drive_through(states, STEP_S, np.array(WEIGHTS), NEARNESS)
    directions = np.column_stack([np.cos(states[:, 2]), np.sin(states[:, 2])])
    for m in range(15):
        for component in range(2):
            now = np.zeros((16, COORDINATES))
            now[m, INPUT + component] = 1.0
            for k in range(15):
                advance(linear.motion[k], STEP_S, now[k], now[k + 1])
            for k in range(m + 1, 16):
                x, y = states[k, :2] - states[m + 1, :2]
                turned, stretched = (-STEP_S * y, STEP_S * x), STEP_S**2 * directions[m + 1 : k].sum(axis=0)
                expected = turned if component == 0 else stretched
                np.testing.assert_allclose(now[k, P_X : P_X + 2], expected, atol=1e-12)


def test_pulling_back_is_the_transpose_of_advancing():
    random = np.random.default_rng(4)
    _, linear = some_drive(3, 2)
    now, ahead, loads = random.normal(size=(3, COORDINATES))
    ahead[INPUT:] = loads[INPUT:] = 0.0
    advance(linear.motion[1], STEP_S, now, ahead)
    pulled = loads.copy()
    pull_back(linear.motion[1], STEP_S, pulled)
    assert pulled @ now == pytest.approx(loads @ ahead)


def test_adding_quantities_is_the_transpose_of_taking_them():
    random = np.random.default_rng(5)
    coordinates, loads = random.normal(size=COORDINATES), random.normal(size=QUANTITIES)
    out = np.zeros(COORDINATES)
    add_quantities(loads, STEP_S, out)
    assert out @ coordinates == pytest.approx(loads @ quantity_matrix() @ coordinates)


def test_limited_quantities_are_position_speed_inputs_and_their_rates():
    states = euler((1.0, 2.0, 0.5, 1.0), [(0.2, 0.4), (0.3, -0.1)])
    (turn_before, before), (turn, acceleration) = recovered_inputs(states, STEP_S)
    coordinates = np.array([9.0, 9.0, 9.0, *states[1], turn_before, before, turn, acceleration])
    rates = [(turn - turn_before) / STEP_S, (acceleration - before) / STEP_S]
    expected = [*states[1, :2], states[1, 3], turn, acceleration, *rates]
    assert quantity_matrix() @ coordinates == pytest.approx(expected)


@pytest.mark.parametrize("stages", [1, 2, 15, 40])
def test_the_recursion_solves_the_equations_that_dense_algebra_solves(stages):
    random = np.random.default_rng(stages)
    states, linear = some_drive(stages, stages)
    squares = random.random((stages, QUANTITIES)) + 0.1
    # Small enough for positive stage costs: each entry of the rank-one term takes a seventh of a square.
    rank_one = random.uniform(-1.0, 1.0, (stages, QUANTITIES)) * np.sqrt(squares / QUANTITIES)
    costs = StageCosts(squares, 0.05 * random.random(stages), 0.5 * rank_one)
    loads, end = random.normal(size=(stages, COORDINATES)), random.normal(size=COORDINATES)
    end[INPUT:] = 0.0

    by_inputs, take = coordinates_by_differences(states), quantity_matrix()
    matrix = np.zeros((2 * stages + 3, 2 * stages + 3))
    right = np.zeros(2 * stages + 3)
    u, goal = slice(2 * stages), slice(2 * stages, None)
    matrix[u, u] = 0.5 * by_inputs[-1, STATE].T @ by_inputs[-1, STATE]
    matrix[goal, goal] = -2.0 * np.diag(NEARNESS)
    for k in range(stages):
        cost = np.diag(squares[k]) - np.outer(costs.rank_one[k], costs.rank_one[k])
        cost[0, 1] = cost[1, 0] = cost[0, 1] + costs.product[k]
        of_quantities = take @ by_inputs[k]
        matrix[u, u] += of_quantities.T @ cost @ of_quantities
        coupling = 2.0 * by_inputs[k, P_X : P_X + 3].T * WEIGHTS[:3]
        matrix[u, goal] += coupling
        matrix[goal, u] += coupling.T
        right[u] += by_inputs[k].T @ loads[k]
        right[goal] += loads[k, GOAL : GOAL + 3]
    right[u] += by_inputs[-1].T @ end
    right[goal] += end[GOAL : GOAL + 3]
    expected = np.linalg.solve(matrix, right)

    changes = np.zeros((stages + 1, COORDINATES))
    solve(linear, factorise(linear, costs), loads, end, changes)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(changes[:-1, INPUT:].ravel(), expected[u], atol=1e-6 * scale)
    for k in range(stages + 1):
        np.testing.assert_allclose(changes[k, GOAL : GOAL + 3], expected[goal], atol=1e-6 * scale)
        np.testing.assert_allclose(changes[k, STATE], by_inputs[k, STATE] @ expected[u], atol=1e-6 * scale)
