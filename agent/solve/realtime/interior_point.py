"""The quadratic program of one step, by a primal–dual interior-point method (Mehrotra's predictor–corrector).

    min_d Σ_i (½ dᵢᵀHᵢdᵢ + gᵢᵀdᵢ) + ρ Σ_r t_r
    s.t.  low ≤ A dᵢ ≤ high for every robot,    gap_r + C_r d + t_r ≥ 0,  t_r ≥ 0 for every row r.

The limits stay within each robot's own matrix Hᵢ + AᵀDA, which is factorised alone. Robots meet only in the
rows of their distances, through the Schur complement of those, and a row takes part only once it is nearly
tight: far more rows exist than ever matter.
"""

from typing import NamedTuple

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.problem import LIMITED_QUANTITIES
from agent.solve.realtime.cholesky import factorise, solve_transposed, solve_upper
from agent.solve.realtime.distances import NOBODY, Rows, add_forces, gaps_after
from agent.solve.realtime.limits import (
    add_transposed_limits,
    apply_limits,
    limit_bands,
)
from agent.solve.realtime.profiles import displacements, pull_back
from agent.solve.realtime.stagewise import (
    WIDTH,
    factorise_stages,
    solve_stages,
    solve_stages_transposed,
)
from agent.solve.vehicle import Array, Booleans, Integers

NEAR_M = 0.05
"""Rows with a smaller gap take part from the beginning."""
TIGHT_M = 0.02
"""Rows whose linearised gap falls below this during the iterations begin to take part; of the rows of one
pair of robots, those that are worse than the worst by no more than this."""
TO_BOUNDARY = 0.995
"""Part of the way to the nearest bound that a step may go."""
FIRST_MEAN = 2.0
"""Product of each slack and its multiplier at the beginning: less is faster where little changes, and much
slower where much does."""
FIRST_MEAN_PER_M = 1e3
"""The same for each metre by which a row is violated: its multiplier may have to grow as large as ρ."""
LEAST_SLACK = 0.2
"""Of a limit at the beginning, relative to the size of its interval, where no multiplier is expected."""
LEAST_GAP_M = 0.1
"""Slack of a row at its beginning."""
LARGE = 100.0
"""A mean multiplier of limits that is."""
MOST_ITERATIONS = 200
MOST_ROWS_A_ROBOT = 32
"""There is room for this many rows a robot (and two robots more); those beyond it do not take part."""


class Program(NamedTuple):
    """The data of the quadratic program for M robots with n = 2K variables each."""

    weights: Array
    """2Q of the positions, shape (2,)."""
    blocks: Array
    """The rest of the Hessians, shape (M, K, 3); see ``cost.blocks_of``."""
    gradients: Array
    """Shape (M, n)."""
    arms: Array
    """Shape (M, n, 2): how variables move positions, for the Hessians as for C."""
    low: Array
    """Shape (M, 5K)."""
    high: Array
    rows: Rows
    forces: Array
    """On the positions, to expect, shape (M, K + 1, 2)."""
    penalty: float
    """ρ, the price of a violated row a metre."""
    step_s: float


class Iterate(NamedTuple):
    """Primal and dual variables; the first index of slacks and pressures is the side: low, high."""

    change: Array
    """d, shape (M, n)."""
    slack: Array
    """Of the limits, shape (2, M, 5K)."""
    pressure: Array
    """Multipliers of the limits, shape (2, M, 5K)."""
    row_slack: Array
    """Of the rows that take part, shape (capacity,), as the following."""
    violation: Array
    """t."""
    force: Array
    """λ of the rows; that of t ≥ 0 is ρ − λ."""
    taking_part: Integers
    """Indices of those rows among all."""


class System(NamedTuple):
    """Residuals of the optimality conditions at an iterate, and the factorised Newton system."""

    stationarity: Array
    """Shape (M, n)."""
    limits: Array
    """Shape (2, M, 5K)."""
    rows: Array
    """Shape (capacity,)."""
    over_slack: Array
    """1 / slack of the limits, shape (2, M, 5K)."""
    over_pressure: Array
    """1 / pressure."""
    factors: Array
    """Rows of Uᵢ, UᵢᵀUᵢ = Hᵢ + AᵀDA; see ``stagewise``, shape (M, n, 8)."""
    halves: Array
    """Uᵢ⁻ᵀC_rᵀ for both robots of a row, shape (capacity, 2, n)."""
    starts: Integers
    """First entry of a row's halves that is not zero."""
    schur: Array
    """U of C (H + AᵀDA)⁻¹ Cᵀ + W, shape (capacity, capacity)."""


class Outcome(NamedTuple):
    """What came of solving a program."""

    change: Array
    """d, shape (M, n)."""
    forces: Array
    """Of the rows on the positions, shape (M, K + 1, 2)."""
    pressures: Array
    """Multipliers of the limits, shape (2, M, 5K)."""
    largest_force: float
    """Of any single row."""
    solved: bool
    iterations: int
    taking_part: Integers
    """Rows of the system that was factorised last."""
    system: System
    """As it was factorised last, at the solution or just before it."""


@kernel
def solve_program(program: Program, pressures: Array, tolerance: float) -> Outcome:
    """Solve the program from d = 0, to a tolerance on stationarity, feasibility and complementarity.

    Args:
        program: the data.
        pressures: multipliers of the limits to expect, shape (2, M, 5K); zero where nothing is known.
        tolerance: the same for all conditions.
    """
    robots, size = program.gradients.shape
    capacity = MOST_ROWS_A_ROBOT * (robots + 2)
    iterate, direction = _empty(robots, size, capacity), _empty(robots, size, capacity)
    system = _empty_system(robots, size, capacity)
    taken = np.zeros(len(program.rows.gap), np.bool_)
    count = _begin(program, iterate, pressures, taken)
    solved, iterations, factorised = False, 0, 0
    while not solved and iterations < MOST_ITERATIONS:
        _set_residuals(program, iterate, count, system)
        mean = _complementarity(program, iterate, direction, count, 0.0)
        error = max(_largest_residual(iterate, system, count), mean)
        solved = error <= tolerance
        if solved or not np.isfinite(error) or not _factorise(program, iterate, count, system):
            break
        iterations, factorised = iterations + 1, count
        _find_direction(program, iterate, count, system, 0.0, False, direction)
        length = _longest_step(program, iterate, system, direction, count)
        after = _complementarity(program, iterate, direction, count, length)
        _find_direction(program, iterate, count, system, mean * (after / mean) ** 3, True, direction)
        length = min(1.0, TO_BOUNDARY * _longest_step(program, iterate, system, direction, count))
        _advance(iterate, direction, count, length)
        count = _let_in(program, iterate, taken, count, TIGHT_M, mean)
    forces = np.zeros((robots, size // 2 + 1, 2))
    add_forces(program.rows, iterate.taking_part[:count], iterate.force, forces)
    largest = 0.0
    for at in range(count):
        largest = max(largest, iterate.force[at])
    return Outcome(
        iterate.change,
        forces,
        iterate.pressure,
        largest,
        solved,
        iterations,
        iterate.taking_part[:factorised],
        system,
    )


@kernel
def respond(program: Program, outcome: Outcome, gradients: Array) -> Array:
    """How the solution changes with the gradients, to first order and as long as the same rows are tight.

    Args:
        program: that was solved.
        outcome: its solution.
        gradients: changes of the gradients, shape (M, n).

    Returns:
        The change of d, shape (M, n).
    """
    system, count = outcome.system, len(outcome.taking_part)
    result, rows = -gradients, np.zeros(count)
    for robot in range(len(result)):
        solve_stages_transposed(system.factors[robot], program.arms[robot], 0, result[robot])
    _push(program, outcome.taking_part, system, rows, result)
    for robot in range(len(result)):
        solve_stages(system.factors[robot], program.arms[robot], result[robot])
    return result


@kernel
def _empty(robots: int, size: int, capacity: int) -> Iterate:
    limits = size // 2 * LIMITED_QUANTITIES
    return Iterate(
        np.zeros((robots, size)),
        np.zeros((2, robots, limits)),
        np.zeros((2, robots, limits)),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros(capacity, np.int64),
    )


@kernel
def _empty_system(robots: int, size: int, capacity: int) -> System:
    limits = size // 2 * LIMITED_QUANTITIES
    return System(
        np.empty((robots, size)),
        np.empty((2, robots, limits)),
        np.empty(capacity),
        np.empty((2, robots, limits)),
        np.empty((2, robots, limits)),
        np.empty((robots, size, WIDTH)),
        np.empty((capacity, 2, size)),
        np.empty(capacity, np.int64),
        np.empty((capacity, capacity)),
    )


@kernel
def _begin(program: Program, iterate: Iterate, pressures: Array, taken: Booleans) -> int:
    """Begin near the central path: with the expected multipliers, and products of at least a first mean."""
    mean = FIRST_MEAN
    for gap in program.rows.gap:
        mean = max(mean, -FIRST_MEAN_PER_M * gap)
    for robot in range(len(program.low)):
        for row in range(program.low.shape[1]):
            low, high = program.low[robot, row], program.high[robot, row]
            least = LEAST_SLACK * (high - low)
            for side in range(2):
                gap = high if side == 1 else -low
                pressure = max(pressures[side, robot, row], mean / max(gap, least))
                iterate.pressure[side, robot, row] = pressure
                iterate.slack[side, robot, row] = max(gap, mean / pressure)
    return _let_in(program, iterate, taken, 0, NEAR_M, mean)


@kernel
def _let_in(
    program: Program, iterate: Iterate, taken: Booleans, count: int, threshold: float, mean: float
) -> int:
    """Let rows with a gap below the threshold take part, worst ones first; return how many do."""
    shifts, gaps = np.zeros((len(iterate.change), iterate.change.shape[1] // 2 + 1, 2)), np.empty(len(taken))
    for robot in range(len(shifts)):
        displacements(program.arms[robot], iterate.change[robot], shifts[robot])
    gaps_after(program.rows, shifts, gaps)
    for pair in range(program.rows.each):
        limit = _limit_of(gaps, taken, pair, program.rows.each, threshold)
        for row in range(pair, len(taken), program.rows.each):
            # What is not a number takes part too, and ends the iterations.
            if not (gaps[row] >= limit or taken[row]) and count < len(iterate.force):
                taken[row] = True
                slack = max(gaps[row], LEAST_GAP_M)
                force = min(max(mean / slack, _expected_force(program, row)), 0.5 * program.penalty)
                iterate.taking_part[count] = row
                iterate.row_slack[count] = max(gaps[row], mean / force)
                iterate.force[count] = force
                iterate.violation[count] = mean / (program.penalty - force)
                count += 1
    return count


@kernel
def _limit_of(gaps: Array, taken: Booleans, pair: int, each: int, threshold: float) -> float:
    """The gap from which rows of a pair are left out for now.

    Once the worst row holds, its neighbours in time mostly hold too.
    """
    limit = threshold
    for row in range(pair, len(gaps), each):
        if not taken[row]:
            limit = min(limit, gaps[row] + TIGHT_M)
    return limit


@kernel
def _expected_force(program: Program, row: int) -> float:
    """Of one row: as much of what pushes its robots as may come from it."""
    i, j, k = program.rows.first[row], program.rows.second[row], program.rows.stage[row]
    x, y = program.rows.normal[row, 0], program.rows.normal[row, 1]
    force: float = x * program.forces[i, k, 0] + y * program.forces[i, k, 1]
    if j != NOBODY:
        force = min(force, -x * program.forces[j, k, 0] - y * program.forces[j, k, 1])
    return force


@kernel
def _set_residuals(program: Program, iterate: Iterate, count: int, system: System) -> None:
    robots, size = iterate.change.shape
    limited = np.empty(program.low.shape[1])
    shifts, forces = np.zeros((robots, size // 2 + 1, 2)), np.zeros((robots, size // 2 + 1, 2))
    add_forces(program.rows, iterate.taking_part[:count], -iterate.force[:count], forces)
    for robot in range(robots):
        change, result = iterate.change[robot], system.stationarity[robot]
        displacements(program.arms[robot], change, shifts[robot])
        apply_limits(change, program.step_s, limited)
        for row in range(len(limited)):
            system.limits[0, robot, row] = (
                limited[row] - program.low[robot, row] - iterate.slack[0, robot, row]
            )
            system.limits[1, robot, row] = (
                program.high[robot, row] - limited[row] - iterate.slack[1, robot, row]
            )
        for slot in range(0, size, 2):
            block = program.blocks[robot, slot // 2]
            heading, speed = change[slot], change[slot + 1]
            result[slot] = program.gradients[robot, slot] + block[0] * heading + block[1] * speed
            result[slot + 1] = program.gradients[robot, slot + 1] + block[1] * heading + block[2] * speed
        for row in range(len(limited)):
            limited[row] = iterate.pressure[1, robot, row] - iterate.pressure[0, robot, row]
        add_transposed_limits(limited, program.step_s, result)
        for k in range(len(forces[robot])):
            for c in range(2):
                forces[robot, k, c] += program.weights[c] * shifts[robot, k, c]
        pull_back(program.arms[robot], forces[robot], result)
    gaps = np.empty(len(program.rows.gap))
    gaps_after(program.rows, shifts, gaps)
    for at in range(count):
        row = iterate.taking_part[at]
        system.rows[at] = gaps[row] + iterate.violation[at] - iterate.row_slack[at]


@kernel
def _largest_residual(iterate: Iterate, system: System, count: int) -> float:
    """Stationarity is judged relative to large multipliers, whose rounding errors it holds."""
    scale = max(1.0, iterate.pressure.mean() / LARGE)
    robots: float = max(_largest(system.stationarity.ravel()) / scale, _largest(system.limits.ravel()))
    return max(robots, _largest(system.rows[:count]))


@kernel
def _largest(values: Array) -> float:
    """The largest size of all; not a number where one of them is none."""
    largest = 0.0
    for value in values:
        size: float = abs(value)
        if not size <= largest:
            largest = size
        if size != size:
            return size
    return largest


@kernel
def _complementarity(
    program: Program, iterate: Iterate, direction: Iterate, count: int, length: float
) -> float:
    """Mean product of slacks and multipliers after a step of some length."""
    total = 0.0
    slack, pressure = iterate.slack.ravel(), iterate.pressure.ravel()
    more_slack, more_pressure = direction.slack.ravel(), direction.pressure.ravel()
    for at in range(len(slack)):
        total += (slack[at] + length * more_slack[at]) * (pressure[at] + length * more_pressure[at])
    for at in range(count):
        force = iterate.force[at] + length * direction.force[at]
        total += (iterate.row_slack[at] + length * direction.row_slack[at]) * force
        violation = iterate.violation[at] + length * direction.violation[at]
        total += violation * (program.penalty - force)
    return total / (len(slack) + 2 * count)


@kernel
def _factorise(program: Program, iterate: Iterate, count: int, system: System) -> bool:
    """Factorise every robot's matrix, then the Schur complement of the rows that take part."""
    robots, size = iterate.change.shape
    _invert(iterate, system)
    weights, bands = np.empty(program.low.shape[1]), np.empty((size, 3))
    for robot in range(robots):
        weights[:] = 0.0
        for side in range(2):
            pressure, over_slack = iterate.pressure[side, robot], system.over_slack[side, robot]
            for row in range(len(weights)):
                weights[row] += pressure[row] * over_slack[row]
        limit_bands(weights, program.step_s, bands)
        if not factorise_stages(
            program.arms[robot], program.weights, program.blocks[robot], bands, system.factors[robot]
        ):
            return False
    _set_halves(program, iterate.taking_part[:count], system)
    _set_coupling(program.rows, iterate.taking_part[:count], robots, system)
    for at in range(count):
        system.schur[at, at] += (
            iterate.violation[at] / (program.penalty - iterate.force[at])
            + iterate.row_slack[at] / iterate.force[at]
        )
    return factorise(system.schur, count)


@kernel
def _invert(iterate: Iterate, system: System) -> None:
    """1 / slack and 1 / pressure by one division for both: it takes longer than all else here."""
    slack, pressure = iterate.slack.ravel(), iterate.pressure.ravel()
    over_slack, over_pressure = system.over_slack.ravel(), system.over_pressure.ravel()
    for at in range(len(slack)):
        over_both = 1.0 / (slack[at] * pressure[at])
        over_slack[at] = pressure[at] * over_both
        over_pressure[at] = slack[at] * over_both


@kernel
def _set_halves(program: Program, taking_part: Integers, system: System) -> None:
    """U⁻ᵀC_rᵀ for both robots of each row; the second's normal has the other sign."""
    first, second, stage, normal = (
        program.rows.first,
        program.rows.second,
        program.rows.stage,
        program.rows.normal,
    )
    arms, halves, factors = program.arms, system.halves, system.factors
    size = arms.shape[1]
    for at in range(len(taking_part)):
        row = taking_part[at]
        start = size + 2 - 2 * stage[row]
        system.starts[at] = start
        x, y = normal[row, 0], normal[row, 1]
        for side in range(2):
            robot = first[row] if side == 0 else second[row]
            if robot != NOBODY:
                arm, half = arms[robot], halves[at, side]
                for slot in range(start, size):
                    half[slot] = arm[slot, 0] * x + arm[slot, 1] * y
                solve_stages_transposed(factors[robot], arm, start, half)
            x, y = -x, -y


@kernel
def _set_coupling(rows: Rows, taking_part: Integers, robots: int, system: System) -> None:
    """C (H + AᵀDA)⁻¹ Cᵀ: for two rows, one product of halves for each robot that both concern."""
    count = len(taking_part)
    schur, halves, starts = system.schur, system.halves, system.starts
    for at in range(count):
        schur[at, at:count] = 0.0
    concerning, sides = np.empty(count, np.int64), np.empty(count, np.int64)
    for robot in range(robots):
        size = 0
        for at in range(count):
            row = taking_part[at]
            if rows.first[row] == robot or rows.second[row] == robot:
                concerning[size], sides[size] = at, 0 if rows.first[row] == robot else 1
                size += 1
        for one in range(size):
            at, half = concerning[one], halves[concerning[one], sides[one]]
            for two in range(one, size):
                other = concerning[two]
                start = max(starts[at], starts[other])
                schur[at, other] += _product(half, halves[other, sides[two]], start)


@kernel
def _product(one: Array, two: Array, start: int) -> float:
    # Four sums side by side: one alone would wait for each of its additions. The number of slots is even.
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    slot = start
    while slot + 4 <= len(one):
        a += one[slot] * two[slot]
        b += one[slot + 1] * two[slot + 1]
        c += one[slot + 2] * two[slot + 2]
        d += one[slot + 3] * two[slot + 3]
        slot += 4
    while slot < len(one):
        a += one[slot] * two[slot]
        slot += 1
    return (a + b) + (c + d)


@kernel
def _robot_of(rows: Rows, row: int, side: int) -> int:
    robot: int = rows.first[row] if side == 0 else rows.second[row]
    return robot


@kernel
def _find_direction(
    program: Program,
    iterate: Iterate,
    count: int,
    system: System,
    centre: float,
    correct: bool,
    direction: Iterate,
) -> None:
    """The Newton direction towards products of slack and multiplier equal to ``centre``.

    With ``correct``, the products' second-order terms of the present direction are made up for (Mehrotra).
    """
    robots, size = iterate.change.shape
    second_order = 1.0 if correct else 0.0
    rows = np.empty(count)
    for at in range(count):
        on_slack, on_violation = _row_targets(program, iterate, direction, at, centre, second_order)
        direction.row_slack[at], direction.violation[at] = on_slack, on_violation
        rows[at] = (
            on_slack / iterate.force[at]
            - on_violation / (program.penalty - iterate.force[at])
            - system.rows[at]
        )
    limited = np.empty(program.low.shape[1])
    for robot in range(robots):
        limited[:] = 0.0
        for side in range(2):
            sign = 1.0 - 2.0 * side
            pressure, over_slack = iterate.pressure[side, robot], system.over_slack[side, robot]
            more_slack, more_pressure = direction.slack[side, robot], direction.pressure[side, robot]
            residual = system.limits[side, robot]
            for row in range(len(limited)):
                target = centre - second_order * more_slack[row] * more_pressure[row]
                share = (target - pressure[row] * residual[row]) * over_slack[row] - pressure[row]
                more_pressure[row] = share
                limited[row] += sign * share
        right = direction.change[robot]
        for slot in range(size):
            right[slot] = -system.stationarity[robot, slot]
        add_transposed_limits(limited, program.step_s, right)
        solve_stages_transposed(system.factors[robot], program.arms[robot], 0, right)
    _solve_rows(program, iterate, count, system, rows, direction)
    for robot in range(robots):
        solve_stages(system.factors[robot], program.arms[robot], direction.change[robot])
        apply_limits(direction.change[robot], program.step_s, limited)
        for side in range(2):
            sign = 1.0 - 2.0 * side
            pressure, over_slack = iterate.pressure[side, robot], system.over_slack[side, robot]
            more_slack, more_pressure = direction.slack[side, robot], direction.pressure[side, robot]
            residual = system.limits[side, robot]
            for row in range(len(limited)):
                more_pressure[row] -= sign * pressure[row] * over_slack[row] * limited[row]
                more_slack[row] = sign * limited[row] + residual[row]


@kernel
def _row_targets(
    program: Program, iterate: Iterate, direction: Iterate, at: int, centre: float, second_order: float
) -> tuple[float, float]:
    """By how much the two products of a row are to change: slack times force, violation times the rest."""
    force, more = iterate.force[at], direction.force[at]
    return (
        centre - iterate.row_slack[at] * force - second_order * direction.row_slack[at] * more,
        centre
        - iterate.violation[at] * (program.penalty - force)
        + second_order * direction.violation[at] * more,
    )


@kernel
def _push(program: Program, taking_part: Integers, system: System, rows: Array, halves: Array) -> None:
    """From half-solved changes of the robots and residuals of the rows to forces, and what these change.

    Args:
        program: the data.
        taking_part: rows that do.
        system: factorised.
        rows: residuals, which become the forces.
        halves: Uᵢ⁻ᵀ times each robot's right-hand side, shape (M, n).
    """
    count, size = len(taking_part), halves.shape[1]
    for at in range(count):
        for side in range(2):
            robot = _robot_of(program.rows, taking_part[at], side)
            if robot != NOBODY:
                for slot in range(system.starts[at], size):
                    rows[at] -= system.halves[at, side, slot] * halves[robot, slot]
    solve_transposed(system.schur, count, rows)
    solve_upper(system.schur, count, rows)
    for at in range(count):
        for side in range(2):
            robot = _robot_of(program.rows, taking_part[at], side)
            if robot != NOBODY:
                for slot in range(system.starts[at], size):
                    halves[robot, slot] += system.halves[at, side, slot] * rows[at]


@kernel
def _solve_rows(
    program: Program, iterate: Iterate, count: int, system: System, rows: Array, direction: Iterate
) -> None:
    """Find the change of the forces, and add its effect to the half-solved changes of the robots."""
    _push(program, iterate.taking_part[:count], system, rows, direction.change)
    for at in range(count):
        force, more = iterate.force[at], rows[at]
        direction.force[at] = more
        direction.row_slack[at] = (direction.row_slack[at] - iterate.row_slack[at] * more) / force
        direction.violation[at] = (direction.violation[at] + iterate.violation[at] * more) / (
            program.penalty - force
        )


@kernel
def _longest_step(
    program: Program, iterate: Iterate, system: System, direction: Iterate, count: int
) -> float:
    """The longest step, at most 1, with which no slack and no multiplier becomes negative."""
    fastest = 1.0
    for side in range(2):
        for robot in range(len(iterate.change)):
            fastest = _fastest(fastest, system.over_slack[side, robot], direction.slack[side, robot])
            fastest = _fastest(fastest, system.over_pressure[side, robot], direction.pressure[side, robot])
    for at in range(count):
        fastest = max(fastest, -direction.row_slack[at] / iterate.row_slack[at])
        fastest = max(fastest, -direction.violation[at] / iterate.violation[at])
        fastest = max(fastest, -direction.force[at] / iterate.force[at])
        fastest = max(fastest, direction.force[at] / (program.penalty - iterate.force[at]))
    return 1.0 / fastest


@kernel
def _fastest(fastest: float, over_values: Array, changes: Array) -> float:
    """The greatest rate at which one of the values goes to zero, if it is more than ``fastest``.

    Five side by side, without branches: one alone would wait for each comparison. Their number is 5K.
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
def _advance(iterate: Iterate, direction: Iterate, count: int, length: float) -> None:
    _move(iterate.change.ravel(), direction.change.ravel(), length)
    _move(iterate.slack.ravel(), direction.slack.ravel(), length)
    _move(iterate.pressure.ravel(), direction.pressure.ravel(), length)
    _move(iterate.row_slack[:count], direction.row_slack[:count], length)
    _move(iterate.violation[:count], direction.violation[:count], length)
    _move(iterate.force[:count], direction.force[:count], length)


@kernel
def _move(values: Array, changes: Array, length: float) -> None:
    for at in range(len(values)):
        values[at] += length * changes[at]
