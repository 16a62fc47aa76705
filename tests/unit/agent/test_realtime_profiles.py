"""Headings and speeds as variables: positions and limited quantities beside full matrices."""

import numpy as np
import pytest
from agent_helpers import STEP_S
from hypothesis import given
from hypothesis import strategies as st
from realtime_helpers import dense, driven, limit_matrix, position_jacobian, slots, stages, wild_states

from agent.solve.realtime.limits import (
    add_transposed_limits,
    apply_limits,
    bounds_of,
    limit_bands,
    limited_quantities,
)
from agent.solve.realtime.profiles import displacements, inputs_of, jacobian_of, moved, pull_back, states_of
from agent.solve.vehicle import recovered_inputs, rollout

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 30)
steps_s = st.sampled_from([0.02, 0.1, 0.5])


@given(seeds, st.integers(1, 4), sizes)
def test_states_are_the_rollout_and_inputs_lead_back_to_them(seed, robots, steps):
    random = np.random.default_rng(seed)
    start, inputs = random.normal(size=(robots, 4)), random.normal(size=(robots, steps, 2))
    states = states_of(start, inputs, STEP_S)
    np.testing.assert_allclose(states, rollout(start, inputs, STEP_S), atol=1e-12)
    np.testing.assert_allclose(inputs_of(states, STEP_S), inputs, atol=1e-11)


@given(seeds, sizes, st.floats(0.0, 1.0))
def test_a_change_moves_headings_and_speeds_and_positions_follow(seed, steps, share):
    random = np.random.default_rng(seed)
    states, change = wild_states(random, 2, steps), random.normal(size=(2, 2 * steps))
    there = moved(states, change, share, STEP_S)
    np.testing.assert_allclose(there[:, 1:, 2:], states[:, 1:, 2:] + share * stages(change), atol=1e-12)
    np.testing.assert_array_equal(there[:, 0], states[:, 0])
    for robot in range(2):
        expected = driven(states[robot], share * change[robot], STEP_S)
        np.testing.assert_allclose(there[robot], expected, atol=1e-11)


@given(seeds, sizes)
def test_displacements_are_the_derivative_of_the_rollout(seed, steps):
    """By a complex step, which has no rounding error to speak of."""
    random = np.random.default_rng(seed)
    states, change = wild_states(random, 1, steps), random.normal(size=2 * steps)
    derivative = driven(states[0], 1e-30j * change, STEP_S).imag[:, :2] / 1e-30
    found = np.full((steps + 1, 2), np.nan)
    displacements(jacobian_of(states, STEP_S)[0], change, found)
    np.testing.assert_allclose(found, derivative, atol=1e-12 * max(1.0, np.abs(derivative).max()))


@given(seeds, sizes)
def test_pulling_back_is_the_transpose_of_displacing_and_adds(seed, steps):
    random = np.random.default_rng(seed)
    jacobian, change = jacobian_of(wild_states(random, 1, steps), STEP_S)[0], random.normal(size=2 * steps)
    forces, before = random.normal(size=(steps + 1, 2)), random.normal(size=2 * steps)
    shifts, pulled = np.empty((steps + 1, 2)), before.copy()
    displacements(jacobian, change, shifts)
    pull_back(jacobian, forces, pulled)
    np.testing.assert_allclose((pulled - before) @ change, (forces * shifts).sum(), atol=1e-10)


def test_the_oracles_matrix_and_order_of_variables_are_those_of_the_kernels():
    """What other tests compare with is itself compared, once."""
    random = np.random.default_rng(4)
    states = wild_states(random, 1, 6)
    jacobian = jacobian_of(states, STEP_S)[0]

    def displaced(change: np.ndarray) -> np.ndarray:
        result = np.empty((7, 2))
        displacements(jacobian, change, result)
        return result.ravel()

    np.testing.assert_allclose(position_jacobian(jacobian).reshape(14, 12), dense(12, displaced), atol=1e-15)
    values = random.normal(size=(3, 6, 2))
    np.testing.assert_array_equal(stages(slots(values)), values)
    np.testing.assert_array_equal(slots(values)[:, :2], values[:, -1])


@given(seeds, sizes, steps_s)
def test_limit_rows_transposed_and_squared_are_those_of_the_full_matrix(seed, steps, step_s):
    """Beyond the bands there is nothing: each variable meets its own of two stages on either side only."""
    random, matrix = np.random.default_rng(seed), limit_matrix(steps, step_s)
    change, rows, weights = (random.uniform(0.0, 9.0, size) for size in (2 * steps, 5 * steps, 5 * steps))
    applied, pulled, bands = np.full(5 * steps, np.nan), change.copy(), np.full((2 * steps, 3), np.nan)
    apply_limits(change, step_s, applied)
    np.testing.assert_allclose(applied, matrix @ change, rtol=1e-10, atol=1e-9)
    add_transposed_limits(rows, step_s, pulled)
    np.testing.assert_allclose(pulled - change, matrix.T @ rows, rtol=1e-10, atol=1e-9)
    limit_bands(weights, step_s, bands)
    full = np.zeros((2 * steps, 2 * steps))
    for slot in range(2 * steps):
        for band in range(min(3, (2 * steps - slot + 1) // 2)):
            full[slot, slot + 2 * band] = full[slot + 2 * band, slot] = bands[slot, band]
    expected = matrix.T @ np.diag(weights) @ matrix
    np.testing.assert_allclose(full, expected, atol=1e-12 * np.abs(expected).max())


@given(seeds, sizes)
def test_limited_quantities_are_those_of_the_recovered_inputs(seed, steps):
    random = np.random.default_rng(seed)
    path, previous = wild_states(random, 1, steps)[0], random.normal(size=2)
    rows = np.full(5 * steps, np.nan)
    limited_quantities(path, previous, STEP_S, rows)
    inputs = recovered_inputs(path, STEP_S)
    changes = np.diff(np.vstack([previous, inputs]), axis=0)
    expected = np.concatenate([inputs.T.ravel(), changes.T.ravel(), path[1:, 3]])
    np.testing.assert_allclose(rows, expected, atol=1e-12)


def test_bounds_stand_in_the_order_of_the_rows():
    bounds = bounds_of(np.array([1.57, 3.0]), np.array([0.05, 0.7]), 4.5, 2)
    assert bounds == pytest.approx([1.57, 1.57, 3.0, 3.0, 0.05, 0.05, 0.7, 0.7, 4.5, 4.5])
