"""What the real-time solver is made of, beside plain formulas, differences and full matrices."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from agent_helpers import STEP_S, problem_of
from hypothesis import given, settings
from hypothesis import strategies as st
from realtime_helpers import dense, driven, limit_matrix, position_jacobian, stages, wild_states

from agent.solve.problem import FIRST_FREE_STAGE
from agent.solve.realtime.cost import LEAST_CURVATURE, blocks_of, cost_of, gradient_of
from agent.solve.realtime.distances import (
    NOBODY,
    Rows,
    add_forces,
    gaps_after,
    rows_about,
    violations_of,
)
from agent.solve.realtime.factorisation import (
    WIDTH,
    factorise,
    factorise_stages,
    solve_stages,
    solve_stages_transposed,
    solve_transposed,
    solve_upper,
)
from agent.solve.realtime.profiles import (
    add_transposed_limits,
    apply_limits,
    displacements,
    inputs_of,
    jacobian_of,
    limit_bands,
    limited_quantities,
    moved,
    pull_back,
    states_of,
)
from agent.solve.vehicle import recovered_inputs, rollout

few = settings(max_examples=12)
seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 12)
odd_sizes = st.sampled_from([1, 2, 3, 4, 7, 30])
steps_s = st.sampled_from([0.02, 0.1, 0.5])
AREA = np.array([[-5.0, -4.0], [6.0, 7.0]])
robots_, obstacles_, steps_ = st.integers(1, 4), st.integers(0, 3), st.integers(1, 6)


@few
@given(seeds, st.integers(1, 4), sizes)
def test_states_are_the_rollout_and_inputs_lead_back_to_them(seed, robots, steps):
    random = np.random.default_rng(seed)
    start, inputs = random.normal(size=(robots, 4)), random.normal(size=(robots, steps, 2))
    states = states_of(start, inputs, STEP_S)
    np.testing.assert_allclose(states, rollout(start, inputs, STEP_S), atol=1e-12)
    np.testing.assert_allclose(inputs_of(states, STEP_S), inputs, atol=1e-11)


@few
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


@few
@given(seeds, sizes)
def test_displacements_are_the_derivative_of_the_rollout_and_pulling_back_adds_their_transpose(seed, steps):
    """By a complex step, which has no rounding error to speak of."""
    random = np.random.default_rng(seed)
    states, change = wild_states(random, 1, steps), random.normal(size=2 * steps)
    derivative = driven(states[0], 1e-30j * change, STEP_S).imag[:, :2] / 1e-30
    jacobian, found = jacobian_of(states, STEP_S)[0], np.full((steps + 1, 2), np.nan)
    displacements(jacobian, change, found)
    np.testing.assert_allclose(found, derivative, atol=1e-12 * max(1.0, np.abs(derivative).max()))
    forces, before = random.normal(size=(steps + 1, 2)), random.normal(size=2 * steps)
    pulled = before.copy()
    pull_back(jacobian, forces, pulled)
    np.testing.assert_allclose((pulled - before) @ change, (forces * found).sum(), atol=1e-9)


@few
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


@few
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


def a_case(seed: int, steps: int, robots: int = 2):
    random = np.random.default_rng(seed)
    states = wild_states(random, robots, steps)
    goals = random.normal(size=(robots, 4)) * [4.0, 4.0, 2.0, 0.0]
    return random, states, goals, random.uniform(0.01, 2.0, 4)


def lagrangian(path, goal, weights, forces, change):
    """Of one robot, after a change (n,); forces stand for constraints that are linear in the positions."""
    there = driven(path, change, STEP_S)
    return (weights * (there - goal) ** 2).sum() - (forces * there[:, :2]).sum()


def lagrangian_gradient(path, goal, weights, forces, change):
    """By a complex step in each variable."""
    size = 1e-30
    steps = [
        lagrangian(path, goal, weights, forces, change + size * 1j * unit).imag / size
        for unit in np.eye(len(change))
    ]
    return np.array(steps)


@few
@given(seeds, st.integers(1, 4), sizes)
def test_the_cost_is_that_of_the_problem(seed, robots, steps):
    _, states, goals, weights = a_case(seed, steps, robots)
    problem = replace(problem_of(states[:, 0], goals, weights=weights), steps=steps)
    assert cost_of(states, goals, weights) == pytest.approx(problem.objective(states), rel=1e-12)


@few
@given(seeds, sizes)
def test_the_gradient_is_the_derivative_of_the_cost_of_the_rollout(seed, steps):
    _, states, goals, weights = a_case(seed, steps)
    found = gradient_of(states, goals, weights, jacobian_of(states, STEP_S))
    for robot in range(2):
        expected = lagrangian_gradient(
            states[robot], goals[robot], weights, np.zeros((steps + 1, 2)), np.zeros(2 * steps)
        )
        np.testing.assert_allclose(found[robot], expected, atol=1e-12 * max(1.0, np.abs(expected).max()))


def quadratic_model(blocks, jacobian, weights):
    """Σ_k (∂p_k)ᵀ 2Q ∂p_k and a block a stage, as one matrix."""
    jacobian = position_jacobian(jacobian)
    model = np.einsum("c,kcm,kcn->mn", 2.0 * weights[:2], jacobian, jacobian)
    for stage, (turning, mixed, speeding) in enumerate(blocks):
        here = slice(2 * stage, 2 * stage + 2)
        model[here, here] += [[turning, mixed], [mixed, speeding]]
    return model


@few
@given(seeds, sizes)
def test_where_no_block_is_projected_the_model_is_the_second_derivative_of_the_lagrangian(seed, steps):
    """A stage's heading and speed enter positions by its own v (cos ψ, sin ψ) only, so nothing is left out.

    Weights of headings and speeds are so large here that all blocks are positive definite.
    """
    random, states, goals, weights = a_case(seed, steps, robots=1)
    forces = random.normal(scale=30.0, size=(1, steps + 1, 2))
    weights[2:] += 1e3 * steps
    blocks = blocks_of(states, goals, weights, forces, STEP_S)[0]
    assert (blocks[:, 0] * blocks[:, 2] > blocks[:, 1] ** 2).all()
    size = 1e-4

    def difference(unit):
        above, below = (
            lagrangian_gradient(states[0], goals[0], weights, forces[0], sign * size * unit)
            for sign in (1, -1)
        )
        return (above - below) / (2 * size)

    expected = dense(2 * steps, difference)
    found = quadratic_model(blocks, jacobian_of(states, STEP_S)[0], weights)
    curved = 2.0 * np.diag(np.resize(weights[2:], 2 * steps))
    # What the large weights add is exact on both sides, and would hide everything else.
    scale = max(1.0, np.abs(expected - curved).max())
    np.testing.assert_allclose(found - curved, expected - curved, atol=1e-5 * scale)


@few
@given(seeds, sizes)
def test_projection_raises_low_eigenvalues_and_leaves_the_rest_as_it_is(seed, steps):
    """Blocks with large weights show what they would be: only the diagonal differs."""
    random, states, goals, weights = a_case(seed, steps, robots=1)
    forces = random.normal(scale=30.0, size=(1, steps + 1, 2))
    heavy = weights + np.array([0.0, 0.0, 1e3, 1e3]) * steps
    projected = blocks_of(states, goals, weights, forces, STEP_S)[0]
    exact = blocks_of(states, goals, heavy, forces, STEP_S)[0] - 2e3 * steps * np.array([1.0, 0.0, 1.0])
    for found, true in zip(projected, exact, strict=True):
        values, vectors = np.linalg.eigh([[true[0], true[1]], [true[1], true[2]]])
        raised = vectors @ np.diag(np.maximum(values, LEAST_CURVATURE)) @ vectors.T
        np.testing.assert_allclose(found, raised[[0, 0, 1], [0, 1, 1]], atol=1e-9 * max(1.0, values[-1]))
    least = [np.linalg.eigvalsh([[a, b], [b, d]])[0] for a, b, d in projected]
    assert (np.array(least) >= LEAST_CURVATURE * (1 - 1e-6) - 1e-12 * np.abs(projected).max()).all()


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


@few
@given(seeds, odd_sizes, st.integers(0, 29))
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


@few
@given(seeds, odd_sizes, st.integers(0, 29), st.booleans())
def test_a_matrix_that_is_not_positive_definite_is_refused(seed, steps, stage, heading):
    case = Case(seed, steps)
    slot = 2 * (stage % steps) + heading
    excess = 1.01 / np.linalg.inv(case.matrix)[slot, slot]
    case.blocks[slot // 2, 2 if heading else 0] -= excess
    case.matrix[slot, slot] -= excess
    assert np.linalg.eigvalsh(case.matrix)[0] < 0.0
    assert not case.factorise()


@few
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


@few
@given(seeds, st.integers(1, 20))
def test_dense_matrices_that_are_not_positive_definite_are_refused(seed, size):
    random = np.random.default_rng(seed)
    root, spoiled = random.normal(size=(size, size)), int(random.integers(size))
    matrix = root @ root.T + 0.1 * np.eye(size)
    matrix[spoiled, spoiled] -= 1.01 / np.linalg.inv(matrix)[spoiled, spoiled]
    assert not factorise(matrix, size)


def a_crowd(seed: int, robots: int, obstacles: int, steps: int):
    random = np.random.default_rng(seed)
    states = random.normal(scale=3.0, size=(robots, steps + 1, 4))
    others = random.normal(scale=3.0, size=(obstacles, steps + 1, 2))
    safe = random.uniform(0.5, 3.0, (robots, robots + obstacles))
    safe[:, :robots] = np.maximum(safe[:, :robots], safe[:, :robots].T)
    return random, states, others, safe


def true_gaps(states, others, safe) -> dict[tuple[int, int, int, int], float]:
    """By robot, other body or side of the area, and stage; for sides, the body is −1 … −4."""
    gaps = {}
    robots = len(states)
    bodies = [*states[:, :, :2], *others]
    for k in range(FIRST_FREE_STAGE, states.shape[1]):
        for i, j in combinations(range(len(bodies)), 2):
            if i < robots:
                gaps[i, j, k] = math.dist(bodies[i][k], bodies[j][k]) - safe[i, j]
        for i in range(robots):
            x, y = bodies[i][k]
            sides = (x - AREA[0, 0], AREA[1, 0] - x, y - AREA[0, 1], AREA[1, 1] - y)
            gaps |= {(i, -1 - side, k): gap for side, gap in enumerate(sides)}
    return gaps


def gaps_by_kernel(rows: Rows, shifts) -> np.ndarray:
    gaps = np.full(len(rows.gap), np.nan)
    gaps_after(rows, shifts, gaps)
    return gaps


@few
@given(seeds, robots_, obstacles_, steps_)
def test_there_is_a_row_for_each_gap_that_inputs_can_influence(seed, robots, obstacles, steps):
    _, states, others, safe = a_crowd(seed, robots, obstacles, steps)
    rows = rows_about(states, others, safe, AREA)
    expected = true_gaps(states, others, safe)
    assert len(rows.gap) == len(expected)
    np.testing.assert_allclose(np.sort(rows.gap), np.sort(list(expected.values())), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(rows.normal, axis=1), 1.0, atol=1e-12)
    for (i, j), k, gap in zip(rows.robots, rows.stage, rows.gap, strict=True):
        if j != NOBODY:
            assert i < j < robots
            assert gap == pytest.approx(expected[i, j, k])
        else:
            assert min(abs(gap - expected[key]) for key in expected if (key[0], key[2]) == (i, k)) < 1e-9


@few
@given(seeds, robots_, obstacles_, steps_)
def test_gaps_after_small_displacements_are_the_true_ones(seed, robots, obstacles, steps):
    random, states, others, safe = a_crowd(seed, robots, obstacles, steps)
    rows = rows_about(states, others, safe, AREA)
    turns = random.uniform(0.0, math.tau, size=(robots, steps + 1))
    shifts = 1e-6 * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    np.testing.assert_array_equal(gaps_by_kernel(rows, 0.0 * shifts), rows.gap)
    there = states.copy()
    there[:, :, :2] += shifts
    moved = rows_about(there, others, safe, AREA)
    # The error is of second order, and bodies may be as near as a few centimetres.
    np.testing.assert_allclose(gaps_by_kernel(rows, shifts), moved.gap, atol=1e-8)
    assert not len(rows.gap) or np.abs(moved.gap - rows.gap).max() > 1e-7


@few
@given(seeds, robots_, obstacles_, steps_)
def test_forces_are_the_transpose_of_the_gaps_and_add(seed, robots, obstacles, steps):
    random, states, others, safe = a_crowd(seed, robots, obstacles, steps)
    rows = rows_about(states, others, safe, AREA)
    active = random.permutation(len(rows.gap))[: (len(rows.gap) + 1) // 2]
    sizes, shifts = random.normal(size=len(active)), random.normal(size=(robots, steps + 1, 2))
    before = random.normal(size=(robots, steps + 1, 2))
    forces = before.copy()
    add_forces(rows, active, sizes, forces)
    change = gaps_by_kernel(rows, shifts) - rows.gap
    assert ((forces - before) * shifts).sum() == pytest.approx(sizes @ change[active], abs=1e-9)


@few
@given(seeds, robots_, obstacles_, steps_)
def test_violations_are_the_sum_and_the_largest_of_all_shortfalls(seed, robots, obstacles, steps):
    _, states, others, safe = a_crowd(seed, robots, obstacles, steps)
    shortfalls = [max(-gap, 0.0) for gap in true_gaps(states, others, safe).values()]
    expected = (sum(shortfalls), max(shortfalls, default=0.0))
    assert violations_of(states, others, safe, AREA) == pytest.approx(expected, abs=1e-12)


def test_robots_in_one_place_are_pushed_apart_along_x():
    states = np.ones((2, 3, 4))
    rows = rows_about(states, np.ones((1, 3, 2)), np.full((2, 3), 1.39), AREA)
    near = rows.gap < 0.0
    np.testing.assert_array_equal(rows.normal[near], [[1.0, 0.0]] * 3)
    np.testing.assert_allclose(rows.gap[near], -1.39)
    forces = np.zeros((2, 3, 2))
    add_forces(rows, np.flatnonzero(near)[:1], np.ones(1), forces)
    np.testing.assert_array_equal(forces[:, 2], [[1.0, 0.0], [-1.0, 0.0]])
