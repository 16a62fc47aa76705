"""The limits of a vehicle as rows: products against full matrices, and values against recovered inputs."""

import numpy as np
import pytest
from agent_helpers import STEP_S
from hypothesis import given
from hypothesis import strategies as st
from realtime_helpers import dense, limit_matrix, wild_states

from agent.solve.realtime.limits import (
    add_transposed_limits,
    apply_limits,
    bounds_of,
    limit_bands,
    limited_quantities,
)
from agent.solve.realtime.profiles import moved
from agent.solve.vehicle import recovered_inputs

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 30)
steps_s = st.sampled_from([0.02, 0.1, 0.5])


def applied(change: np.ndarray, step_s: float) -> np.ndarray:
    rows = np.full(len(change) // 2 * 5, np.nan)
    apply_limits(change, step_s, rows)
    return rows


@given(sizes, steps_s)
def test_rows_are_inputs_their_changes_and_speeds(steps, step_s):
    found = dense(2 * steps, lambda unit: applied(unit, step_s))
    np.testing.assert_allclose(found, limit_matrix(steps, step_s), rtol=1e-12, atol=1e-12)


@given(seeds, sizes, steps_s)
def test_the_transpose_is_the_transpose_and_adds(seed, steps, step_s):
    random = np.random.default_rng(seed)
    rows, before = random.normal(size=5 * steps), random.normal(size=2 * steps)
    result = before.copy()
    add_transposed_limits(rows, step_s, result)
    np.testing.assert_allclose(result - before, limit_matrix(steps, step_s).T @ rows, atol=1e-10)


@given(seeds, sizes, steps_s)
def test_bands_hold_all_of_the_weighted_square_of_the_rows(seed, steps, step_s):
    """And there is nothing beyond them: each variable meets its own of two stages on either side only."""
    weights = np.random.default_rng(seed).uniform(0.0, 10.0, 5 * steps)
    bands = np.full((2 * steps, 3), np.nan)
    limit_bands(weights, step_s, bands)
    matrix = limit_matrix(steps, step_s)
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


@given(seeds, sizes)
def test_a_change_of_the_variables_changes_the_limited_quantities_by_the_rows(seed, steps):
    random = np.random.default_rng(seed)
    states, change = wild_states(random, 1, steps), random.normal(size=(1, 2 * steps))
    before, after = np.empty(5 * steps), np.empty(5 * steps)
    limited_quantities(states[0], np.zeros(2), STEP_S, before)
    limited_quantities(moved(states, change, 1.0, STEP_S)[0], np.zeros(2), STEP_S, after)
    np.testing.assert_allclose(after - before, applied(change[0], STEP_S), atol=1e-9)


def test_bounds_stand_in_the_order_of_the_rows():
    bounds = bounds_of(np.array([1.57, 3.0]), np.array([0.05, 0.7]), 4.5, 2)
    assert bounds == pytest.approx([1.57, 1.57, 3.0, 3.0, 0.05, 0.05, 0.7, 0.7, 4.5, 4.5])
