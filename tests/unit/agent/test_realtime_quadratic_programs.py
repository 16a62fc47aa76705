"""The interior-point method against a maintained solver, on recorded and on random programs.

The oracle gets the program written out with full matrices and a slack for each row, from its definition.
"""

import numpy as np
import pytest
from agent_helpers import STEP_S
from hypothesis import given, settings
from hypothesis import strategies as st
from realtime_helpers import (
    by_the_oracle,
    dense_program,
    limit_matrix,
    position_jacobian,
    random_crossing,
    recorded_programs,
)

from agent.solve.realtime.distances import NOBODY, Rows
from agent.solve.realtime.kkt import Program
from agent.solve.realtime.qp import MOST_ITERATIONS, Outcome, solve_program
from agent.solve.realtime.solver import TOLERANCE
from agent.solve.vehicle import Array

TIGHT = 1e-6
"""Tolerance with which solutions are compared; the solver's own one leaves visible differences."""


def no_multipliers(program: Program) -> Array:
    return np.zeros((2, *program.low.shape))


def solve(program: Program, tolerance: float = TIGHT) -> Outcome:
    return solve_program(program, no_multipliers(program), tolerance)


@pytest.fixture(scope="module")
def recorded() -> list[Program]:
    """Those of closed loops of three to five robots, while they are in one another's way."""
    crossings = ((3, 1, range(0, 12, 3)), (4, 0, range(0, 12, 4)), (5, 3, range(0, 2, 2)))
    return [
        program
        for robots, seed, steps in crossings
        for program in recorded_programs(random_crossing(robots, seed), steps)
    ]


def random_program(random: np.random.Generator, robots: int, steps: int, rows: int) -> Program:
    """Positive definite blocks, limits that allow standing still, and rows of any kind and gap."""
    size = 2 * steps
    roots = random.normal(size=(robots, steps, 2, 2))
    positive = roots @ roots.swapaxes(2, 3) + 1e-2 * np.eye(2)
    angles = random.uniform(0, 2 * np.pi, rows)
    first, offset = random.integers(robots, size=(2, rows))
    second = np.where(offset, (first + offset) % robots, NOBODY)
    low, high = random.uniform(0.0, 2.0, (2, robots, 5 * steps))
    low[random.random(low.shape) < 0.1] = 0.0
    return Program(
        weights=random.uniform(0.1, 3.0, (steps + 1, 2)),
        blocks=positive[:, :, [0, 0, 1], [0, 1, 1]].copy(),
        gradients=random.normal(scale=10.0, size=(robots, size)),
        jacobian=random.normal(size=(robots, size, 2)),
        low=-low,
        high=high,
        rows=Rows(
            random.integers(1, rows + 2),
            np.column_stack([first, second]),
            random.integers(2, steps + 1, size=rows),
            np.column_stack([np.cos(angles), np.sin(angles)]),
            random.normal(scale=0.3, size=rows),
        ),
        forces=random.normal(scale=10.0, size=(robots, steps + 1, 2)),
        penalty=10.0 ** random.uniform(1.0, 4.0),
        step_s=random.choice([0.02, 0.1, 0.5]),
    )


def assert_as_the_oracle(program: Program, outcome: Outcome) -> None:
    assert outcome.solved
    written_out = dense_program(program)
    found, expected = outcome.change.ravel(), by_the_oracle(written_out)
    value = written_out.value(expected)
    # TIGHT is the mean product of slack and multiplier; there are some thousand of them.
    assert written_out.value(found) == pytest.approx(value, rel=1e-6, abs=3e3 * TIGHT)
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_recorded_programs_are_solved_as_by_the_oracle(recorded):
    outcomes = [solve(program) for program in recorded]
    pushed = [outcome.largest_multiplier > 1.0 for outcome in outcomes]
    assert sum(pushed) >= 4, "distances are meant to matter"
    for program, outcome in zip(recorded, outcomes, strict=True):
        assert_as_the_oracle(program, outcome)


@settings(max_examples=12, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(2, 8), st.integers(0, 12))
def test_random_programs_are_solved_as_by_the_oracle(seed, robots, steps, rows):
    program = random_program(np.random.default_rng(seed), robots, steps, rows)
    assert_as_the_oracle(program, solve(program))


def test_solutions_balance_and_keep_limits_rows_and_signs(recorded):
    """Karush, Kuhn and Tucker's conditions, for each program, with the multipliers that are handed on."""
    for program in recorded:
        outcome = solve(program, TOLERANCE)
        assert outcome.solved
        size = outcome.change.shape[1]
        written_out, limits = dense_program(program), limit_matrix(size // 2, STEP_S)
        low, high = outcome.limit_multipliers
        assert (outcome.limit_multipliers >= 0.0).all()
        pushed = [
            np.einsum("kc,kcn->n", forces, position_jacobian(jacobian))
            for forces, jacobian in zip(outcome.forces, program.jacobian, strict=True)
        ]
        balance = written_out.hessian @ outcome.change.ravel() + written_out.gradient
        balance += ((high - low) @ limits - pushed).ravel()
        np.testing.assert_allclose(balance, 0.0, atol=2 * TOLERANCE)
        quantities = outcome.change @ limits.T
        room = np.array([quantities - program.low, program.high - quantities])
        assert (room >= -2 * TOLERANCE).all()
        # Complementarity is kept on average; room is slack within the tolerance of feasibility.
        assert (room * outcome.limit_multipliers).mean() <= 2 * TOLERANCE * (
            1.0 + outcome.limit_multipliers.mean()
        )
        gaps = program.rows.gap + written_out.rows @ outcome.change.ravel()
        assert gaps.min() >= -1e-6 - 2 * TOLERANCE, "all of these can be kept"
        if gaps.min() > 0.01:
            assert outcome.largest_multiplier < 0.1


def test_distances_that_cannot_be_kept_cost_their_price_and_no_more(recorded):
    """All robots, and all sides of the area, would have to be a metre further apart at once."""
    for program in recorded[::3]:
        gap = np.where(program.rows.stage <= 4, -1.0, program.rows.gap)
        crowded = program._replace(rows=program.rows._replace(gap=gap))
        outcome = solve(crowded, TOLERANCE)
        assert outcome.solved
        assert outcome.largest_multiplier == pytest.approx(program.penalty, rel=1e-6)
        quantities = outcome.change @ limit_matrix(outcome.change.shape[1] // 2, STEP_S).T
        assert (quantities >= program.low - 1e-4).all()
        assert (quantities <= program.high + 1e-4).all()
        written_out = dense_program(crowded)
        best = written_out.value(by_the_oracle(written_out))
        assert written_out.value(outcome.change.ravel()) == pytest.approx(best, rel=1e-4)


def test_multipliers_of_the_solution_make_solving_again_quick(recorded):
    iterations = {"first": 0, "again": 0}
    for program in recorded:
        first = solve(program, TOLERANCE)
        again = solve_program(program._replace(forces=first.forces), first.limit_multipliers, TOLERANCE)
        assert again.solved
        np.testing.assert_allclose(again.change, first.change, atol=0.02)
        iterations["first"] += first.iterations
        iterations["again"] += again.iterations
    assert iterations["again"] < 0.9 * iterations["first"]


@pytest.mark.parametrize(
    "part",
    ["weights", "blocks", "gradients", "jacobian", "low", "high", "normal", "gap", "limit_multipliers"],
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_program_with_a_value_that_is_no_number_is_not_solved(recorded, part, value):
    program, limit_multipliers = recorded[3], no_multipliers(recorded[3])
    rows = program.rows
    near = int(rows.gap.argmin())
    if part == "limit_multipliers":
        limit_multipliers[0, 1, 7] = value
    elif part in ("normal", "gap"):
        spoiled = getattr(rows, part).copy()
        spoiled[near] = -value
        program = program._replace(rows=rows._replace(**{part: spoiled}))
    else:
        spoiled = getattr(program, part).copy()
        spoiled[(-1,) * spoiled.ndim] = value
        program = program._replace(**{part: spoiled})
    assert not solve_program(program, limit_multipliers, TOLERANCE).solved


def test_what_cannot_be_reached_and_a_hessian_that_is_not_positive_definite_are_not_solved(recorded):
    program = recorded[0]
    outcome = solve(program, tolerance=-1.0)
    assert not outcome.solved
    assert 0 < outcome.iterations <= MOST_ITERATIONS
    assert not solve(program._replace(blocks=program.blocks - np.array([1e4, 0.0, 0.0]))).solved
