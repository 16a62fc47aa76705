"""A robot's matrix, factorised stage by stage, and dense ones: against numpy with the matrix written out."""

import numpy as np
import pytest
from agent_helpers import STEP_S
from hypothesis import given
from hypothesis import strategies as st
from realtime_helpers import limit_matrix, position_jacobian

from agent.solve.realtime.cholesky import factorise, solve_transposed, solve_upper
from agent.solve.realtime.limits import limit_bands
from agent.solve.realtime.stagewise import (
    WIDTH,
    factorise_stages,
    solve_stages,
    solve_stages_transposed,
)

seeds = st.integers(0, 2**32 - 1)
sizes = st.sampled_from([1, 2, 3, 4, 7, 30])


class Case:
    """A robot's matrix M by its parts, and written out."""

    def __init__(self, seed: int, steps: int) -> None:
        random = np.random.default_rng(seed)
        self.random, self.size = random, 2 * steps
        self.jacobian = random.normal(size=(self.size, 2))
        self.weights = random.uniform(0.1, 3.0, 2)
        roots = random.normal(size=(steps, 2, 2))
        positive = roots @ roots.swapaxes(1, 2) + 1e-3 * np.eye(2)
        self.blocks = positive[:, [0, 0, 1], [0, 1, 1]].copy()
        rows = random.uniform(0.0, 5.0, 5 * steps)
        self.bands = np.empty((self.size, 3))
        limit_bands(rows, STEP_S, self.bands)
        jacobian, limits = position_jacobian(self.jacobian), limit_matrix(steps, STEP_S)
        self.matrix = np.einsum("c,kcm,kcn->mn", self.weights, jacobian, jacobian)
        self.matrix += limits.T @ np.diag(rows) @ limits
        for stage in range(steps):
            here = slice(2 * stage, 2 * stage + 2)
            self.matrix[here, here] += positive[stage]
        self.factor = np.full((self.size, WIDTH), np.nan)

    def factorise(self) -> bool:
        return factorise_stages(self.jacobian, self.weights, self.blocks, self.bands, self.factor)

    @property
    def upper(self) -> np.ndarray:
        return np.linalg.cholesky(self.matrix).T


def assert_close(found, expected) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * max(1.0, np.abs(expected).max()))


@given(seeds, sizes, st.integers(0, 29))
def test_solving_stage_by_stage_is_solving_with_the_whole_matrix(seed, steps, stage):
    """Leading zeros are neither read nor written."""
    case, first = Case(seed, steps), 2 * (stage % steps)
    right = case.random.normal(size=case.size)
    right[:first] = 0.0
    assert case.factorise()
    half = right.copy()
    half[:first] = np.nan
    solve_stages_transposed(case.factor, case.jacobian, first, half)
    assert np.isnan(half[:first]).all()
    half[:first] = 0.0
    assert_close(half, np.linalg.solve(case.upper.T, right))
    whole = half.copy()
    solve_stages(case.factor, case.jacobian, whole)
    assert_close(whole, np.linalg.solve(case.upper, half))
    assert_close(case.matrix @ whole, right)


@given(seeds, sizes, st.integers(0, 29), st.booleans())
def test_a_matrix_that_is_not_positive_definite_is_refused(seed, steps, stage, heading):
    case = Case(seed, steps)
    slot = 2 * (stage % steps) + heading
    excess = 1.01 / np.linalg.inv(case.matrix)[slot, slot]
    case.blocks[slot // 2, 2 if heading else 0] -= excess
    case.matrix[slot, slot] -= excess
    assert np.linalg.eigvalsh(case.matrix)[0] < 0.0
    assert not case.factorise()


@pytest.mark.parametrize("part", ["jacobian", "blocks", "bands", "weights"])
def test_a_matrix_that_holds_no_number_is_refused(part):
    case = Case(0, 6)
    getattr(case, part)[-1] = np.nan
    assert not case.factorise()


@given(seeds, st.integers(0, 40), st.integers(0, 5))
def test_dense_matrices_are_factorised_and_solved_as_numpy_does(seed, size, spare):
    """Only the upper triangle of the leading part is read or written."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(size, size))
    matrix = root @ root.T + 0.1 * np.eye(size)
    room = np.full((size + spare, size + spare), np.nan)
    room[:size, :size][np.triu_indices(size)] = matrix[np.triu_indices(size)]
    assert factorise(room, size)
    upper = np.linalg.cholesky(matrix).T
    np.testing.assert_allclose(
        room[:size, :size][np.triu_indices(size)], upper[np.triu_indices(size)], atol=1e-8
    )
    assert np.isnan(room).sum() == room.size - size * (size + 1) // 2
    right = random.normal(size=size + spare)
    found = right.copy()
    solve_transposed(room, size, found)
    np.testing.assert_allclose(found[:size], np.linalg.solve(upper.T, right[:size]), atol=1e-6)
    solve_upper(room, size, found)
    np.testing.assert_allclose(matrix @ found[:size], right[:size], atol=1e-6)
    np.testing.assert_array_equal(found[size:], right[size:])


@given(seeds, st.integers(1, 20), st.sampled_from(["indefinite", "no number"]))
def test_dense_matrices_that_are_not_positive_definite_are_refused(seed, size, flaw):
    random = np.random.default_rng(seed)
    root, spoiled = random.normal(size=(size, size)), int(random.integers(size))
    matrix = root @ root.T + 0.1 * np.eye(size)
    if flaw == "indefinite":
        matrix[spoiled, spoiled] -= 1.01 / np.linalg.inv(matrix)[spoiled, spoiled]
    else:
        matrix[: spoiled + 1, spoiled] = np.nan
    assert not factorise(matrix, size)
