"""What the real-time solver is made of, beside plain formulas, differences and full matrices."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from agent_helpers import SAFETY_M, STEP_S, problem_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from realtime_helpers import dense, driven, position_jacobian, wild_states

from agent.solve.problem import FIRST_FREE_STAGE
from agent.solve.realtime.cost import blocks_of, gradient_of
from agent.solve.realtime.distances import NOBODY, gaps_after, rows_about, violations_of
from agent.solve.realtime.profiles import displacements, jacobian_of, pull_back

few = settings(max_examples=12)
seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 12)
AREA = np.array([[-5.0, -4.0], [6.0, 7.0]])


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


def a_case(seed: int, steps: int, robots: int = 2):
    random = np.random.default_rng(seed)
    states = wild_states(random, robots, steps)
    goals = random.normal(size=(robots, 4)) * [4.0, 4.0, 2.0, 0.0]
    return random, states, goals, random.uniform(0.01, 2.0, (steps + 1, 4))


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
    model = np.einsum("kc,kcm,kcn->mn", 2.0 * weights[:, :2], jacobian, jacobian)
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
    weights[:, 2:] += 1e3 * steps
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
    curved = 2.0 * np.diag(weights[:0:-1, 2:].ravel())
    # What the large weights add is exact on both sides, and would hide everything else.
    scale = max(1.0, np.abs(expected - curved).max())
    np.testing.assert_allclose(found - curved, expected - curved, atol=1e-5 * scale)


def true_gaps(states, others, safe) -> dict[tuple[int, int, int], float]:
    """By robot, other body or side of the area, and stage; for sides, the body is −1 … −4."""
    gaps = {}
    bodies = [*states[:, :, :2], *others]
    for k in range(FIRST_FREE_STAGE, states.shape[1]):
        for i, j in combinations(range(len(bodies)), 2):
            if i < len(states):
                gaps[i, j, k] = math.dist(bodies[i][k], bodies[j][k]) - safe[i, j]
        for i in range(len(states)):
            x, y = bodies[i][k]
            sides = (x - AREA[0, 0], AREA[1, 0] - x, y - AREA[0, 1], AREA[1, 1] - y)
            gaps |= {(i, -1 - side, k): gap for side, gap in enumerate(sides)}
    return gaps


@few
@given(seeds, st.integers(1, 4), st.integers(0, 3), st.integers(1, 6))
def test_there_is_a_row_for_each_gap_that_inputs_can_influence_and_it_says_how_it_changes(
    seed, robots, obstacles, steps
):
    random = np.random.default_rng(seed)
    states = random.normal(scale=3.0, size=(robots, steps + 1, 4))
    others = random.normal(scale=3.0, size=(obstacles, steps + 1, 2))
    safe = random.uniform(0.5, 3.0, (robots, robots + obstacles))
    safe[:, :robots] = np.maximum(safe[:, :robots], safe[:, :robots].T)
    rows, expected = rows_about(states, others, safe, 0.0 * safe, AREA), true_gaps(states, others, safe)
    np.testing.assert_allclose(np.sort(rows.gap), np.sort(list(expected.values())), atol=1e-12)
    for (i, j), k, gap in zip(rows.robots, rows.stage, rows.gap, strict=True):
        if j != NOBODY:
            assert i < j < robots
            assert gap == pytest.approx(expected[i, j, k])
        else:
            assert min(abs(gap - expected[key]) for key in expected if (key[0], key[2]) == (i, k)) < 1e-9
    shortfalls = [max(-gap, 0.0) for gap in expected.values()]
    violations = (sum(shortfalls), max(shortfalls, default=0.0))
    assert violations_of(states, others, safe, 0.0 * safe, AREA) == pytest.approx(violations, abs=1e-12)
    there = states.copy()
    there[:, :, :2] += 1e-6 * random.uniform(-1.0, 1.0, (robots, steps + 1, 2))
    found, moved = np.full(len(rows.gap), np.nan), rows_about(there, others, safe, 0.0 * safe, AREA)
    gaps_after(rows, (there - states)[:, :, :2], found)
    # The error is of second order, and bodies may be as near as a few centimetres.
    np.testing.assert_allclose(found, moved.gap, atol=1e-8)


@settings(max_examples=200)
@given(seeds, st.integers(1, 2), st.integers(0, 2), st.integers(2, 4), st.sampled_from([0.3, 1.0, 3.0]))
def test_the_violation_of_a_problem_is_the_largest_shortfall_of_its_rows(
    seed, robots, obstacles, steps, scale
):
    """The one is written in arrays, the other as a kernel; robots may even be in one place at first."""
    random, count = np.random.default_rng(seed), robots + obstacles
    states = random.normal(scale=scale, size=(robots, steps + 1, 4))
    others = random.normal(scale=scale, size=(obstacles, steps + 1, 2))
    safe, sides = random.uniform(0.5, 3.0, (count, count)), np.triu(random.integers(-1, 2, (count, count)), 1)
    safe, sides = np.maximum(safe, safe.T)[:robots], np.array(sides + sides.T, dtype=float)[:robots]
    problem = problem_of(states[:, 0], states[:, -1], obstacles=others, steps=steps)
    problem = replace(problem, safety_distances=safe, sides=sides)
    for _ in range(2):
        _, largest_m = violations_of(states, others, safe, sides, 1e3 * AREA)
        assert problem.violation_m(states) == pytest.approx(largest_m, abs=1e-12)
        states[1:, 0] = states[:1, 0]


bearings = st.floats(-math.pi, math.pi)


@given(bearings, st.sampled_from([-1.0, 1.0]), st.floats(-3.0, 3.0), st.floats(1.6, 5.0))
def test_a_trajectory_without_violation_is_one_that_passes_on_the_agreed_side(bearing, side, beside, apart):
    """Of two robots that change places: the way from the one to the other winds as was agreed."""
    problem = problem_of(np.zeros((2, 4)), np.zeros((2, 4)), steps=40)
    problem = replace(problem, sides=side * (np.ones((2, 2)) - np.eye(2)))
    along = np.linspace(-apart, apart, 41)
    way = (along + 1j * beside * np.cos(along / apart * math.pi / 2)) * np.exp(1j * bearing)
    states = np.zeros((2, 41, 4))
    for robot, part in ((0, -0.3), (1, 0.7)):  # the middle of the two moves, too
        states[robot, :, 0], states[robot, :, 1] = (part * way).real, (part * way).imag
    turned = float(np.angle(way[1:] * way[:-1].conj()).sum())
    room = np.abs(way)[FIRST_FREE_STAGE:].min() - SAFETY_M
    assume(abs(room) > 1e-9)
    assert (problem.violation_m(states) < 1e-12) == (room > 0.0 and turned * side > 0.0)


def gap_at(x, y, side):
    """Of a pair and its normal at a stage at which it is apart by (x, y), seen along its present sight."""
    states, turn = np.zeros((2, 3, 4)), np.exp(0.7j)
    for stage, apart in ((0, 5.0 * turn), (2, (x + 1j * y) * turn)):
        states[0, stage, :2] = apart.real, apart.imag
    nobody, size = np.zeros((0, 3, 2)), np.full((2, 2), SAFETY_M)
    rows = rows_about(states, nobody, size, side * size / SAFETY_M, AREA)
    normal = complex(*rows.normal[0]) / turn
    return float(rows.gap[0]), np.array([normal.real, normal.imag])


agreed = st.sampled_from([-1.0, 1.0])


@given(bearings, st.floats(-4.0, 4.0), agreed, bearings)
def test_the_gap_of_an_agreed_side_does_not_jump_where_rows_begin_to_lead_to_it(
    bearing, away, side, direction
):
    """At the circle, at the line of sight beyond it, and on the wrong side where the circle begins."""
    circle = (SAFETY_M * math.cos(bearing), SAFETY_M * math.sin(bearing))
    sight = (math.copysign(SAFETY_M + abs(away), away), 0.0)
    begins = (math.copysign(SAFETY_M, away), -side * abs(away))
    for x, y in (circle, sight, begins):
        there = x + 1e-10 * math.cos(direction), y + 1e-10 * math.sin(direction)
        # The circle is steep where it begins: a change there by ε is one by √ε beside it.
        assert gap_at(*there, side)[0] == pytest.approx(gap_at(x, y, side)[0], abs=1e-4)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), agreed)
def test_rows_of_an_agreed_side_touch_the_circle_beside_the_other_and_elsewhere_are_derivatives(x, y, side):
    """The half-plane of a violated row touches it on the agreed side, as far along the sight as it is now."""
    assume(min(abs(math.hypot(x, y) - SAFETY_M), abs(y), abs(abs(x) - SAFETY_M)) > 1e-3)
    gap, normal = gap_at(x, y, side)
    if gap < 0.0:
        there = np.array([x, side * math.sqrt(SAFETY_M**2 - x**2)])
        np.testing.assert_allclose(SAFETY_M * normal, there, atol=1e-9)
        assert gap == pytest.approx(normal @ [x, y] - SAFETY_M, abs=1e-9)
    else:
        slopes = [(gap_at(x + dx, y + dy, side)[0] - gap) / 1e-6 for dx, dy in ((1e-6, 0.0), (0.0, 1e-6))]
        np.testing.assert_allclose(slopes, normal, atol=1e-5)
