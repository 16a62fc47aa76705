"""The optimality conditions (Karush, Kuhn, Tucker) of the quadratic program, and Newton's step on them.

    Hᵢdᵢ + gᵢ + Aᵀ(μ_high − μ_low) − Σ_r C_rᵀλ_r = 0 for every robot, slacks∘multipliers → 0 from above

Slacks and multipliers of the limits are eliminated within each robot's own matrix Hᵢ + AᵀDA = UᵢᵀUᵢ, which is
factorised alone; what is left couples robots through the active rows only, by their Schur complement.
"""

from typing import NamedTuple

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.problem import LIMITED_QUANTITIES
from agent.solve.realtime.cholesky import factorise, solve_transposed, solve_upper
from agent.solve.realtime.distances import NOBODY, Rows, add_forces, gaps_after
from agent.solve.realtime.limits import add_transposed_limits, apply_limits, limit_bands
from agent.solve.realtime.profiles import displacements, pull_back
from agent.solve.realtime.stagewise import WIDTH, factorise_stages, solve_stages, solve_stages_transposed
from agent.solve.vehicle import Array, Integers

LARGE = 100.0
"""A mean multiplier of limits that is."""


class Program(NamedTuple):
    """The data of the quadratic program for M robots with n = 2K variables each."""

    weights: Array
    """2Q of the positions, shape (2,)."""
    blocks: Array
    """The rest of the Hessians, shape (M, K, 3); see ``cost.blocks_of``."""
    gradients: Array
    """Shape (M, n)."""
    jacobian: Array
    """Shape (M, n, 2): how variables move positions, for the Hessians as for C."""
    low: Array
    """Shape (M, 5K)."""
    high: Array
    rows: Rows
    forces: Array
    """Constraint forces on the positions to expect, Σ λ n over the rows, shape (M, K + 1, 2)."""
    penalty: float
    """ρ, the price of a violated row a metre."""
    step_s: float


class Iterate(NamedTuple):
    """Primal and dual variables; the first index of those of limits is the side: low, high."""

    change: Array
    """d, shape (M, n)."""
    limit_slack: Array
    """Shape (2, M, 5K)."""
    limit_multiplier: Array
    """Shape (2, M, 5K)."""
    row_slack: Array
    """Of the active rows, shape (capacity,), as the following."""
    violation: Array
    """t."""
    row_multiplier: Array
    """λ; the multiplier of t ≥ 0 is ρ − λ."""
    active: Integers
    """Indices of the active rows among all."""


class Step(NamedTuple):
    """A change of the variables of an iterate, in the same shapes."""

    change: Array
    limit_slack: Array
    limit_multiplier: Array
    row_slack: Array
    violation: Array
    row_multiplier: Array


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
    over_multiplier: Array
    """1 / multiplier of the limits."""
    factors: Array
    """Rows of Uᵢ, UᵢᵀUᵢ = Hᵢ + AᵀDA; see ``stagewise``, shape (M, n, 8)."""
    reduced_rows: Array
    """Uᵢ⁻ᵀC_rᵀ for both robots of a row, shape (capacity, 2, n)."""
    starts: Integers
    """First entry of each reduced row that is not zero."""
    schur: Array
    """U of the Schur complement C (H + AᵀDA)⁻¹ Cᵀ + W of the active rows, shape (capacity, capacity)."""


@kernel
def empty_iterate(robots: int, size: int, capacity: int) -> Iterate:
    """Room for an iterate; all zero."""
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
def empty_step(robots: int, size: int, capacity: int) -> Step:
    """Room for a step; all zero."""
    limits = size // 2 * LIMITED_QUANTITIES
    return Step(
        np.zeros((robots, size)),
        np.zeros((2, robots, limits)),
        np.zeros((2, robots, limits)),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros(capacity),
    )


@kernel
def empty_system(robots: int, size: int, capacity: int) -> System:
    """Room for a system."""
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
def set_residuals(program: Program, iterate: Iterate, count: int, system: System) -> None:
    """Write the residuals of the optimality conditions at an iterate with so many active rows."""
    robots, size = iterate.change.shape
    limited = np.empty(program.low.shape[1])
    shifts, forces = np.zeros((robots, size // 2 + 1, 2)), np.zeros((robots, size // 2 + 1, 2))
    add_forces(program.rows, iterate.active[:count], -iterate.row_multiplier[:count], forces)
    for robot in range(robots):
        change, result = iterate.change[robot], system.stationarity[robot]
        displacements(program.jacobian[robot], change, shifts[robot])
        apply_limits(change, program.step_s, limited)
        for row in range(len(limited)):
            system.limits[0, robot, row] = (
                limited[row] - program.low[robot, row] - iterate.limit_slack[0, robot, row]
            )
            system.limits[1, robot, row] = (
                program.high[robot, row] - limited[row] - iterate.limit_slack[1, robot, row]
            )
        for slot in range(0, size, 2):
            block = program.blocks[robot, slot // 2]
            heading, speed = change[slot], change[slot + 1]
            result[slot] = program.gradients[robot, slot] + block[0] * heading + block[1] * speed
            result[slot + 1] = program.gradients[robot, slot + 1] + block[1] * heading + block[2] * speed
        for row in range(len(limited)):
            limited[row] = iterate.limit_multiplier[1, robot, row] - iterate.limit_multiplier[0, robot, row]
        add_transposed_limits(limited, program.step_s, result)
        for k in range(len(forces[robot])):
            for c in range(2):
                forces[robot, k, c] += program.weights[c] * shifts[robot, k, c]
        pull_back(program.jacobian[robot], forces[robot], result)
    gaps = np.empty(len(program.rows.gap))
    gaps_after(program.rows, shifts, gaps)
    for at in range(count):
        row = iterate.active[at]
        system.rows[at] = gaps[row] + iterate.violation[at] - iterate.row_slack[at]


@kernel
def largest_residual(iterate: Iterate, system: System, count: int) -> float:
    """Stationarity is judged relative to large multipliers, whose rounding errors it holds."""
    scale = max(1.0, iterate.limit_multiplier.mean() / LARGE)
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
def factorise_system(program: Program, iterate: Iterate, count: int, system: System) -> bool:
    """Factorise every robot's matrix, then the Schur complement of the active rows."""
    robots, size = iterate.change.shape
    _set_inverses(iterate, system)
    weights, bands = np.empty(program.low.shape[1]), np.empty((size, 3))
    for robot in range(robots):
        weights[:] = 0.0
        for side in range(2):
            limit_multiplier, over_slack = (
                iterate.limit_multiplier[side, robot],
                system.over_slack[side, robot],
            )
            for row in range(len(weights)):
                weights[row] += limit_multiplier[row] * over_slack[row]
        limit_bands(weights, program.step_s, bands)
        if not factorise_stages(
            program.jacobian[robot], program.weights, program.blocks[robot], bands, system.factors[robot]
        ):
            return False
    _reduce_rows(program, iterate.active[:count], system)
    _set_schur(program.rows, iterate.active[:count], robots, system)
    for at in range(count):
        system.schur[at, at] += (
            iterate.violation[at] / (program.penalty - iterate.row_multiplier[at])
            + iterate.row_slack[at] / iterate.row_multiplier[at]
        )
    return factorise(system.schur, count)


@kernel
def _set_inverses(iterate: Iterate, system: System) -> None:
    """1 / slack and 1 / multiplier by one division for both: it takes longer than all else here."""
    slack, limit_multiplier = iterate.limit_slack.ravel(), iterate.limit_multiplier.ravel()
    over_slack, over_multiplier = system.over_slack.ravel(), system.over_multiplier.ravel()
    for at in range(len(slack)):
        over_both = 1.0 / (slack[at] * limit_multiplier[at])
        over_slack[at] = limit_multiplier[at] * over_both
        over_multiplier[at] = slack[at] * over_both


@kernel
def _reduce_rows(program: Program, active: Integers, system: System) -> None:
    """U⁻ᵀC_rᵀ for both robots of each row; the second's normal has the other sign."""
    first, second, stage, normal = (
        program.rows.first,
        program.rows.second,
        program.rows.stage,
        program.rows.normal,
    )
    jacobian, reduced, factors = program.jacobian, system.reduced_rows, system.factors
    size = jacobian.shape[1]
    for at in range(len(active)):
        row = active[at]
        start = size + 2 - 2 * stage[row]
        system.starts[at] = start
        x, y = normal[row, 0], normal[row, 1]
        for side in range(2):
            robot = first[row] if side == 0 else second[row]
            if robot != NOBODY:
                moves, entry = jacobian[robot], reduced[at, side]
                for slot in range(start, size):
                    entry[slot] = moves[slot, 0] * x + moves[slot, 1] * y
                solve_stages_transposed(factors[robot], moves, start, entry)
            x, y = -x, -y


@kernel
def _set_schur(rows: Rows, active: Integers, robots: int, system: System) -> None:
    """C (H + AᵀDA)⁻¹ Cᵀ: for two rows, one product of reduced rows for each robot that both concern."""
    count = len(active)
    schur, reduced, starts = system.schur, system.reduced_rows, system.starts
    for at in range(count):
        schur[at, at:count] = 0.0
    concerning, sides = np.empty(count, np.int64), np.empty(count, np.int64)
    for robot in range(robots):
        size = 0
        for at in range(count):
            row = active[at]
            if rows.first[row] == robot or rows.second[row] == robot:
                concerning[size], sides[size] = at, 0 if rows.first[row] == robot else 1
                size += 1
        for one in range(size):
            at, entry = concerning[one], reduced[concerning[one], sides[one]]
            for two in range(one, size):
                other = concerning[two]
                start = max(starts[at], starts[other])
                schur[at, other] += _product(entry, reduced[other, sides[two]], start)


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
def find_step(
    program: Program,
    iterate: Iterate,
    count: int,
    system: System,
    centring: float,
    correct: bool,
    step: Step,
) -> None:
    """The Newton direction towards products of slack and multiplier equal to ``centring``.

    With ``correct``, the products' second-order terms of the present direction are made up for (Mehrotra).
    """
    robots, size = iterate.change.shape
    second_order = 1.0 if correct else 0.0
    rows = np.empty(count)
    for at in range(count):
        on_slack, on_violation = _row_targets(program, iterate, step, at, centring, second_order)
        step.row_slack[at], step.violation[at] = on_slack, on_violation
        rows[at] = (
            on_slack / iterate.row_multiplier[at]
            - on_violation / (program.penalty - iterate.row_multiplier[at])
            - system.rows[at]
        )
    limited = np.empty(program.low.shape[1])
    for robot in range(robots):
        limited[:] = 0.0
        for side in range(2):
            sign = 1.0 - 2.0 * side
            limit_multiplier, over_slack = (
                iterate.limit_multiplier[side, robot],
                system.over_slack[side, robot],
            )
            slack_step, multiplier_step = step.limit_slack[side, robot], step.limit_multiplier[side, robot]
            residual = system.limits[side, robot]
            for row in range(len(limited)):
                target = centring - second_order * slack_step[row] * multiplier_step[row]
                share = (target - limit_multiplier[row] * residual[row]) * over_slack[row] - limit_multiplier[
                    row
                ]
                multiplier_step[row] = share
                limited[row] += sign * share
        right = step.change[robot]
        for slot in range(size):
            right[slot] = -system.stationarity[robot, slot]
        add_transposed_limits(limited, program.step_s, right)
        solve_stages_transposed(system.factors[robot], program.jacobian[robot], 0, right)
    _finish_rows(program, iterate, count, system, rows, step)
    for robot in range(robots):
        solve_stages(system.factors[robot], program.jacobian[robot], step.change[robot])
        apply_limits(step.change[robot], program.step_s, limited)
        for side in range(2):
            sign = 1.0 - 2.0 * side
            limit_multiplier, over_slack = (
                iterate.limit_multiplier[side, robot],
                system.over_slack[side, robot],
            )
            slack_step, multiplier_step = step.limit_slack[side, robot], step.limit_multiplier[side, robot]
            residual = system.limits[side, robot]
            for row in range(len(limited)):
                multiplier_step[row] -= sign * limit_multiplier[row] * over_slack[row] * limited[row]
                slack_step[row] = sign * limited[row] + residual[row]


@kernel
def _row_targets(
    program: Program, iterate: Iterate, step: Step, at: int, centring: float, second_order: float
) -> tuple[float, float]:
    """By how much the products of a row's slack with λ, and of its violation with ρ − λ, are to change."""
    multiplier, change = iterate.row_multiplier[at], step.row_multiplier[at]
    return (
        centring - iterate.row_slack[at] * multiplier - second_order * step.row_slack[at] * change,
        centring
        - iterate.violation[at] * (program.penalty - multiplier)
        + second_order * step.violation[at] * change,
    )


@kernel
def _finish_rows(
    program: Program, iterate: Iterate, count: int, system: System, rows: Array, step: Step
) -> None:
    """Find the step of the rows, and add its effect to the half-solved changes of the robots."""
    solve_schur(program, iterate.active[:count], system, rows, step.change)
    for at in range(count):
        multiplier, change = iterate.row_multiplier[at], rows[at]
        step.row_multiplier[at] = change
        step.row_slack[at] = (step.row_slack[at] - iterate.row_slack[at] * change) / multiplier
        step.violation[at] = (step.violation[at] + iterate.violation[at] * change) / (
            program.penalty - multiplier
        )


@kernel
def solve_schur(program: Program, active: Integers, system: System, rows: Array, reduced: Array) -> None:
    """From half-solved changes of the robots and residuals of the rows to changes of multipliers, and back.

    Args:
        program: the data.
        active: indices of the active rows.
        system: factorised.
        rows: residuals, which become changes of the multipliers.
        reduced: Uᵢ⁻ᵀ times each robot's right-hand side, shape (M, n); the effect of the rows is added.
    """
    count, size = len(active), reduced.shape[1]
    for at in range(count):
        for side in range(2):
            robot = _robot_of(program.rows, active[at], side)
            if robot != NOBODY:
                for slot in range(system.starts[at], size):
                    rows[at] -= system.reduced_rows[at, side, slot] * reduced[robot, slot]
    solve_transposed(system.schur, count, rows)
    solve_upper(system.schur, count, rows)
    for at in range(count):
        for side in range(2):
            robot = _robot_of(program.rows, active[at], side)
            if robot != NOBODY:
                for slot in range(system.starts[at], size):
                    reduced[robot, slot] += system.reduced_rows[at, side, slot] * rows[at]
