"""The quadratic program of one step, by a primal–dual interior-point method (Mehrotra's predictor–corrector).

    min_d Σ_i (½ dᵢᵀHᵢdᵢ + gᵢᵀdᵢ) + ρ Σ_r t_r
    s.t.  low ≤ A dᵢ ≤ high for every robot,    gap_r + C_r d + t_r ≥ 0,  t_r ≥ 0 for every row r.

Far more rows exist than ever matter, so a row joins the active set only once it is nearly tight; it stays.
"""

from typing import NamedTuple

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.realtime.distances import NOBODY, add_forces, gaps_after
from agent.solve.realtime.kkt import (
    Program,
    System,
    Variables,
    empty_system,
    factorise_system,
    find_step,
    largest_residual,
    no_variables,
    set_residuals,
)
from agent.solve.realtime.profiles import displacements
from agent.solve.vehicle import Array, Booleans, Integers

NEAR = 0.04
"""Rows with a smaller gap, in safety distances as all lengths here, are active from the beginning."""
TIGHT = 0.015
"""Rows whose linearised gap falls below this during the iterations become active; of the rows of one pair of
robots, those that are worse than the worst by no more than this."""
TO_BOUNDARY = 0.995
"""Part of the way to the nearest bound that a step may go."""
FIRST_MEAN = 1.0
"""Product of each slack and its multiplier at the beginning: less is faster where little changes, and much
slower where much does."""
FIRST_MEAN_PER_LENGTH = 700.0
"""The same for each length by which a row is violated: its multiplier may have to grow as large as ρ."""
LEAST_SLACK = 0.2
"""Of a limit at the beginning, relative to the size of its interval, where no multiplier is expected."""
LEAST_GAP = 0.07
"""Slack of a row at its beginning."""
MOST_ITERATIONS = 200
MOST_ROWS_A_ROBOT = 32
"""There is room for this many rows a robot (and two robots more); those beyond it do not become active."""


class Outcome(NamedTuple):
    """What came of solving a program."""

    change: Array
    """d, shape (M, n)."""
    forces: Array
    """Of the rows on the positions, shape (M, K + 1, 2)."""
    limit_multipliers: Array
    """Multipliers of the limits, shape (2, M, 5K)."""
    largest_multiplier: float
    """Of any single row."""
    solved: bool
    iterations: int
    active: Integers
    """Rows of the system that was factorised last."""
    system: System
    """As it was factorised last, at the solution or just before it."""


@kernel
def solve_program(program: Program, limit_multipliers: Array, tolerance: float) -> Outcome:
    """Solve the program from d = 0, to a tolerance on stationarity, feasibility and complementarity.

    Args:
        program: the data.
        limit_multipliers: multipliers of the limits to expect, shape (2, M, 5K); zero where nothing is known.
        tolerance: the same for all conditions.
    """
    robots, size = program.gradients.shape
    capacity = MOST_ROWS_A_ROBOT * (robots + 2)
    iterate, step = no_variables(robots, size, capacity), no_variables(robots, size, capacity)
    system = empty_system(robots, size, capacity)
    is_active = np.zeros(len(program.rows.gap), np.bool_)
    count = _begin(program, iterate, limit_multipliers, system.active, is_active)
    solved, iterations, factorised = False, 0, 0
    while not solved and iterations < MOST_ITERATIONS:
        set_residuals(program, iterate, count, system)
        mean = _complementarity(program, iterate, step, count, 0.0)
        error = max(largest_residual(iterate, system, count), mean)
        solved = error <= tolerance
        if solved or not np.isfinite(error) or not factorise_system(program, iterate, count, system):
            break
        iterations, factorised = iterations + 1, count
        find_step(program, iterate, count, system, 0.0, False, step)
        length = _longest_length(program, iterate, system, step, count)
        after = _complementarity(program, iterate, step, count, length)
        find_step(program, iterate, count, system, mean * (after / mean) ** 3, True, step)
        length = min(1.0, TO_BOUNDARY * _longest_length(program, iterate, system, step, count))
        _advance(iterate, step, count, length)
        count = _activate(program, iterate, system.active, is_active, count, TIGHT, mean)
    forces = np.zeros((robots, size // 2 + 1, 2))
    add_forces(program.rows, system.active[:count], iterate.row_multiplier, forces)
    largest = 0.0
    for at in range(count):
        largest = max(largest, iterate.row_multiplier[at])
    return Outcome(
        iterate.change,
        forces,
        iterate.limit_multiplier,
        largest,
        solved,
        iterations,
        system.active[:factorised],
        system,
    )


@kernel
def _begin(
    program: Program, iterate: Variables, limit_multipliers: Array, active: Integers, is_active: Booleans
) -> int:
    """Begin near the central path: with the expected multipliers, and products of at least a first mean."""
    mean = FIRST_MEAN
    for gap in program.rows.gap:
        mean = max(mean, -FIRST_MEAN_PER_LENGTH * gap)
    for robot in range(len(program.low)):
        for row in range(program.low.shape[1]):
            low, high = program.low[robot, row], program.high[robot, row]
            least = LEAST_SLACK * (high - low)
            for side in range(2):
                gap = high if side == 1 else -low
                multiplier = max(limit_multipliers[side, robot, row], mean / max(gap, least))
                iterate.limit_multiplier[side, robot, row] = multiplier
                iterate.limit_slack[side, robot, row] = max(gap, mean / multiplier)
    return _activate(program, iterate, active, is_active, 0, NEAR, mean)


@kernel
def _activate(
    program: Program,
    iterate: Variables,
    active: Integers,
    is_active: Booleans,
    count: int,
    threshold: float,
    mean: float,
) -> int:
    """Make rows with a gap below the threshold active, worst ones first; return how many are."""
    robots, size = iterate.change.shape
    shifts, gaps = np.zeros((robots, size // 2 + 1, 2)), np.empty(len(is_active))
    for robot in range(len(shifts)):
        displacements(program.jacobian[robot], iterate.change[robot], shifts[robot])
    gaps_after(program.rows, shifts, gaps)
    for pair in range(program.rows.per_stage):
        limit = _activation_gap(gaps, is_active, pair, program.rows.per_stage, threshold)
        for row in range(pair, len(is_active), program.rows.per_stage):
            # What is not a number becomes active too, and ends the iterations.
            if not (gaps[row] >= limit or is_active[row]) and count < len(iterate.row_multiplier):
                is_active[row] = True
                slack = max(gaps[row], LEAST_GAP)
                multiplier = min(max(mean / slack, _expected_multiplier(program, row)), 0.5 * program.penalty)
                active[count] = row
                iterate.row_slack[count] = max(gaps[row], mean / multiplier)
                iterate.row_multiplier[count] = multiplier
                iterate.violation[count] = mean / (program.penalty - multiplier)
                count += 1
    return count


@kernel
def _activation_gap(gaps: Array, is_active: Booleans, pair: int, each: int, threshold: float) -> float:
    """The gap from which rows of a pair are left out for now.

    Once the worst row holds, its neighbours in time mostly hold too.
    """
    limit = threshold
    for row in range(pair, len(gaps), each):
        if not is_active[row]:
            limit = min(limit, gaps[row] + TIGHT)
    return limit


@kernel
def _expected_multiplier(program: Program, row: int) -> float:
    """Of one row: as much of the forces on its robots as may come from it."""
    i, j, k = program.rows.robots[row, 0], program.rows.robots[row, 1], program.rows.stage[row]
    x, y = program.rows.normal[row, 0], program.rows.normal[row, 1]
    multiplier: float = x * program.forces[i, k, 0] + y * program.forces[i, k, 1]
    if j != NOBODY:
        multiplier = min(multiplier, -x * program.forces[j, k, 0] - y * program.forces[j, k, 1])
    return multiplier


@kernel
def _complementarity(
    program: Program, iterate: Variables, step: Variables, count: int, length: float
) -> float:
    """Mean product of slacks and multipliers after a step of some length."""
    total = 0.0
    slack, multiplier = iterate.limit_slack.ravel(), iterate.limit_multiplier.ravel()
    slack_step, multiplier_step = step.limit_slack.ravel(), step.limit_multiplier.ravel()
    for at in range(len(slack)):
        total += (slack[at] + length * slack_step[at]) * (multiplier[at] + length * multiplier_step[at])
    for at in range(count):
        force = iterate.row_multiplier[at] + length * step.row_multiplier[at]
        total += (iterate.row_slack[at] + length * step.row_slack[at]) * force
        total += (iterate.violation[at] + length * step.violation[at]) * (program.penalty - force)
    return total / (len(slack) + 2 * count)


@kernel
def _longest_length(
    program: Program, iterate: Variables, system: System, step: Variables, count: int
) -> float:
    """The longest step, at most 1, with which no slack and no multiplier becomes negative."""
    fastest = _fastest(1.0, system.over_slack.ravel(), step.limit_slack.ravel())
    fastest = _fastest(fastest, system.over_multiplier.ravel(), step.limit_multiplier.ravel())
    for at in range(count):
        fastest = max(fastest, -step.row_slack[at] / iterate.row_slack[at])
        fastest = max(fastest, -step.violation[at] / iterate.violation[at])
        fastest = max(fastest, -step.row_multiplier[at] / iterate.row_multiplier[at])
        fastest = max(fastest, step.row_multiplier[at] / (program.penalty - iterate.row_multiplier[at]))
    return 1.0 / fastest


@kernel
def _fastest(fastest: float, over_values: Array, changes: Array) -> float:
    """The greatest rate at which one of the values goes to zero, if it is more than ``fastest``.

    Five side by side, without branches: one alone would wait for each comparison. Their number is 10MK.
    """
    a, b, c, d, e = fastest, fastest, fastest, fastest, fastest
    for at in range(0, len(changes), 5):
        a = max(a, -changes[at] * over_values[at])
        b = max(b, -changes[at + 1] * over_values[at + 1])
        c = max(c, -changes[at + 2] * over_values[at + 2])
        d = max(d, -changes[at + 3] * over_values[at + 3])
        e = max(e, -changes[at + 4] * over_values[at + 4])
    return max(max(a, b), max(c, d), e)


@kernel
def _advance(iterate: Variables, step: Variables, count: int, length: float) -> None:
    _move(iterate.change.ravel(), step.change.ravel(), length)
    _move(iterate.limit_slack.ravel(), step.limit_slack.ravel(), length)
    _move(iterate.limit_multiplier.ravel(), step.limit_multiplier.ravel(), length)
    _move(iterate.row_slack[:count], step.row_slack[:count], length)
    _move(iterate.violation[:count], step.violation[:count], length)
    _move(iterate.row_multiplier[:count], step.row_multiplier[:count], length)


@kernel
def _move(values: Array, changes: Array, length: float) -> None:
    for at in range(len(values)):
        values[at] += length * changes[at]
