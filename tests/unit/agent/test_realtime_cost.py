"""The cost in headings and speeds: its value, gradient and second derivative against differences."""

from dataclasses import replace

import numpy as np
import pytest
from agent_helpers import STEP_S, problem_of
from hypothesis import given
from hypothesis import strategies as st
from realtime_helpers import dense, driven, position_jacobian, wild_states

from agent.solve.realtime.cost import LEAST_CURVATURE, blocks_of, cost_of, gradient_of
from agent.solve.realtime.profiles import jacobian_of

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 12)


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


@given(seeds, st.integers(1, 4), sizes)
def test_the_cost_is_that_of_the_problem(seed, robots, steps):
    _, states, goals, weights = a_case(seed, steps, robots)
    problem = replace(problem_of(states[:, 0], goals, weights=weights), steps=steps)
    assert cost_of(states, goals, weights) == pytest.approx(problem.objective(states), rel=1e-12)


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


def test_projection_has_work_to_do_in_these_cases():
    """A force against the direction of travel makes turning around look good."""
    states = np.zeros((1, 3, 4))
    states[:, :, 3] = 2.0
    forces = np.zeros((1, 3, 2))
    forces[0, 2] = (-50.0, 0.0)
    block = blocks_of(states, np.zeros((1, 4)), np.array([0.0, 0.0, 0.1, 0.1]), forces, STEP_S)[0, 1]
    # The costate is (50, 0): turning costs −Δt·v·50 = −10, and 0.2 on top.
    np.testing.assert_allclose(block, [LEAST_CURVATURE, 0.0, 0.2], atol=1e-12)
