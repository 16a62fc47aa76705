"""Rows of distances and of the area: gaps against plain geometry, their slopes against differences."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.solve.problem import FIRST_FREE_STAGE
from agent.solve.realtime.distances import (
    NOBODY,
    Rows,
    add_forces,
    gaps_after,
    rows_about,
    violations_of,
)

AREA = np.array([[-5.0, -4.0], [6.0, 7.0]])
seeds = st.integers(0, 2**32 - 1)
robots_, obstacles_, steps_ = st.integers(1, 4), st.integers(0, 3), st.integers(1, 6)


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


@given(seeds, robots_, obstacles_, steps_)
def test_there_is_a_row_for_each_gap_that_inputs_can_influence(seed, robots, obstacles, steps):
    _, states, others, safe = a_crowd(seed, robots, obstacles, steps)
    rows = rows_about(states, others, safe, AREA)
    expected = true_gaps(states, others, safe)
    assert len(rows.gap) == len(expected)
    np.testing.assert_allclose(np.sort(rows.gap), np.sort(list(expected.values())), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(rows.normal, axis=1), 1.0, atol=1e-12)
    for i, j, k, gap in zip(rows.first, rows.second, rows.stage, rows.gap, strict=True):
        if j != NOBODY:
            assert i < j < robots
            assert gap == pytest.approx(expected[i, j, k])
        else:
            assert min(abs(gap - expected[key]) for key in expected if (key[0], key[2]) == (i, k)) < 1e-9


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
