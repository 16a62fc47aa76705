"""The optimality conditions (Karush, Kuhn, Tucker) of the quadratic program, and Newton's step on them.

    Hᵢdᵢ + gᵢ + Aᵀ(μ_high − μ_low) − Σ_r C_rᵀλ_r = 0 for every robot, slacks∘multipliers → 0 from above

Slacks and multipliers of the limits are eliminated within each robot's own matrix Hᵢ + AᵀDA = UᵢᵀUᵢ, which is
factorised alone; what is left couples robots through the active rows only, by their Schur complement.
"""

from typing import NamedTuple

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.problem import LIMITED_QUANTITIES
from agent.solve.realtime.distances import NOBODY, Rows, add_forces, gaps_after
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
    limit_bands,
    pull_back,
)
from agent.solve.vehicle import Array, Integers

LARGE = 100.0
"""A mean multiplier of limits that is."""


class Program(NamedTuple):
    """The data of the quadratic program for M robots with n = 2K variables each."""

    weights: Array
    """2Q of the positions at each stage, shape (K + 1, 2)."""
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


class Variables(NamedTuple):
    """Primal and dual ones, or a step of them; the first index of those of limits is the side: low, high."""

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


class System(NamedTuple):
    """Residuals of the optimality conditions at an iterate, and the factorised Newton system."""

    active: Integers
    """Indices of the active rows among all, shape (capacity,)."""
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
def no_variables(robots: int, size: int, capacity: int) -> Variables:
    """Room for an iterate or a step; all zero."""
    limits = (2, robots, size // 2 * LIMITED_QUANTITIES)
    return Variables(
        np.zeros((robots, size)),
        np.zeros(limits),
        np.zeros(limits),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros(capacity),
    )


@kernel
def empty_system(robots: int, size: int, capacity: int) -> System:
    """Room for a system."""
    limits = (2, robots, size // 2 * LIMITED_QUANTITIES)
    return System(
        np.empty(capacity, np.int64),
        np.empty((robots, size)),
        np.empty(limits),
        np.empty(capacity),
        np.empty(limits),
        np.empty(limits),
        np.empty((robots, size, WIDTH)),
        np.empty((capacity, 2, size)),
        np.empty(capacity, np.int64),
        np.empty((capacity, capacity)),
    )


@kernel
def set_residuals(program: Program, iterate: Variables, count: int, system: System) -> None:
    """Write the residuals of the optimality conditions at an iterate with so many active rows."""
    robots, size = iterate.change.shape
    limited = np.empty(program.low.shape[1])
    shifts, forces = np.zeros((robots, size // 2 + 1, 2)), np.zeros((robots, size // 2 + 1, 2))
    add_forces(program.rows, system.active[:count], -iterate.row_multiplier[:count], forces)
    for robot in range(robots):
        change, result = iterate.change[robot], system.stationarity[robot]
        displacements(program.jacobian[robot], change, shifts[robot])
        apply_limits(change, program.step_s, limited)
        for row in range(len(limited)):
            below, above = limited[row] - program.low[robot, row], program.high[robot, row] - limited[row]
            system.limits[0, robot, row] = below - iterate.limit_slack[0, robot, row]
            system.limits[1, robot, row] = above - iterate.limit_slack[1, robot, row]
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
                forces[robot, k, c] += program.weights[k, c] * shifts[robot, k, c]
        pull_back(program.jacobian[robot], forces[robot], result)
    gaps = np.empty(len(program.rows.gap))
    gaps_after(program.rows, shifts, gaps)
    for at, row in enumerate(system.active[:count]):
        system.rows[at] = gaps[row] + iterate.violation[at] - iterate.row_slack[at]


@kernel
def largest_residual(iterate: Variables, system: System, count: int) -> float:
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
def factorise_system(program: Program, iterate: Variables, count: int, system: System) -> bool:
    """Factorise every robot's matrix, then the Schur complement of the active rows."""
    robots, size = iterate.change.shape
    _set_inverses(iterate, system)
    weights, bands = np.empty(program.low.shape[1]), np.empty((size, 3))
    for robot in range(robots):
        weights[:] = 0.0
        for side in range(2):
            multiplier, over_slack = iterate.limit_multiplier[side, robot], system.over_slack[side, robot]
            for row in range(len(weights)):
                weights[row] += multiplier[row] * over_slack[row]
        limit_bands(weights, program.step_s, bands)
        if not factorise_stages(
            program.jacobian[robot], program.weights, program.blocks[robot], bands, system.factors[robot]
        ):
            return False
    _reduce_rows(program, system.active[:count], system)
    _set_schur(program.rows, system.active[:count], robots, system)
    for at in range(count):
        force = iterate.row_multiplier[at]
        system.schur[at, at] += (
            iterate.violation[at] / (program.penalty - force) + iterate.row_slack[at] / force
        )
    return factorise(system.schur, count)


@kernel
def _set_inverses(iterate: Variables, system: System) -> None:
    """1 / slack and 1 / multiplier by one division for both: it takes longer than all else here."""
    slack, multiplier = iterate.limit_slack.ravel(), iterate.limit_multiplier.ravel()
    over_slack, over_multiplier = system.over_slack.ravel(), system.over_multiplier.ravel()
    for at in range(len(slack)):
        over_both = 1.0 / (slack[at] * multiplier[at])
        over_slack[at] = multiplier[at] * over_both
        over_multiplier[at] = slack[at] * over_both


@kernel
def _reduce_rows(program: Program, active: Integers, system: System) -> None:
    """U⁻ᵀC_rᵀ for both robots of each row; the second's normal has the other sign."""
    rows, size = program.rows, program.jacobian.shape[1]
    for at, row in enumerate(active):
        start = size + 2 - 2 * rows.stage[row]
        system.starts[at] = start
        x, y = rows.normal[row, 0], rows.normal[row, 1]
        for side, robot in enumerate(rows.robots[row]):
            if robot != NOBODY:
                moves, entry = program.jacobian[robot], system.reduced_rows[at, side]
                for slot in range(start, size):
                    entry[slot] = moves[slot, 0] * x + moves[slot, 1] * y
                solve_stages_transposed(system.factors[robot], moves, start, entry)
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
        for at, row in enumerate(active):
            for side in range(2):
                if rows.robots[row, side] == robot:
                    concerning[size], sides[size] = at, side
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
def find_step(
    program: Program,
    iterate: Variables,
    count: int,
    system: System,
    centring: float,
    correct: bool,
    step: Variables,
) -> None:
    """The Newton direction towards products of slack and multiplier equal to ``centring``.

    With ``correct``, the products' second-order terms of the present direction are made up for (Mehrotra).
    Until the multipliers' steps are known, the steps of slacks hold by how much the products are to change.
    """
    robots, size = iterate.change.shape
    second_order = 1.0 if correct else 0.0
    rows, limited = np.empty(count), np.empty(program.low.shape[1])
    for at in range(count):
        force, change = iterate.row_multiplier[at], step.row_multiplier[at]
        free = program.penalty - force
        on_slack = centring - iterate.row_slack[at] * force - second_order * step.row_slack[at] * change
        on_violation = centring - iterate.violation[at] * free + second_order * step.violation[at] * change
        step.row_slack[at], step.violation[at] = on_slack, on_violation
        rows[at] = on_slack / force - on_violation / free - system.rows[at]
    for robot in range(robots):
        limited[:] = 0.0
        for side in range(2):
            sign, residual = 1.0 - 2.0 * side, system.limits[side, robot]
            multiplier, over_slack = iterate.limit_multiplier[side, robot], system.over_slack[side, robot]
            slack_step, multiplier_step = step.limit_slack[side, robot], step.limit_multiplier[side, robot]
            for row in range(len(limited)):
                target = centring - second_order * slack_step[row] * multiplier_step[row]
                share = (target - multiplier[row] * residual[row]) * over_slack[row] - multiplier[row]
                multiplier_step[row] = share
                limited[row] += sign * share
        right = step.change[robot]
        for slot in range(size):
            right[slot] = -system.stationarity[robot, slot]
        add_transposed_limits(limited, program.step_s, right)
        solve_stages_transposed(system.factors[robot], program.jacobian[robot], 0, right)
    solve_schur(program, system.active[:count], system, rows, step.change)
    for at, change in enumerate(rows):
        force = iterate.row_multiplier[at]
        step.row_multiplier[at] = change
        step.row_slack[at] = (step.row_slack[at] - iterate.row_slack[at] * change) / force
        step.violation[at] = (step.violation[at] + iterate.violation[at] * change) / (program.penalty - force)
    for robot in range(robots):
        solve_stages(system.factors[robot], program.jacobian[robot], step.change[robot])
        apply_limits(step.change[robot], program.step_s, limited)
        for side in range(2):
            sign, residual = 1.0 - 2.0 * side, system.limits[side, robot]
            multiplier, over_slack = iterate.limit_multiplier[side, robot], system.over_slack[side, robot]
            slack_step, multiplier_step = step.limit_slack[side, robot], step.limit_multiplier[side, robot]
            for row in range(len(limited)):
                multiplier_step[row] -= sign * multiplier[row] * over_slack[row] * limited[row]
                slack_step[row] = sign * limited[row] + residual[row]


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
    for at, row in enumerate(active):
        for side, robot in enumerate(program.rows.robots[row]):
            if robot != NOBODY:
                for slot in range(system.starts[at], size):
                    rows[at] -= system.reduced_rows[at, side, slot] * reduced[robot, slot]
    solve_transposed(system.schur, count, rows)
    solve_upper(system.schur, count, rows)
    for at, row in enumerate(active):
        for side, robot in enumerate(program.rows.robots[row]):
            if robot != NOBODY:
                for slot in range(system.starts[at], size):
                    reduced[robot, slot] += system.reduced_rows[at, side, slot] * rows[at]
