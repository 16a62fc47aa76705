"""M = UᵀU, and triangular solves: of small dense matrices, and of a robot's own one in time linear in K.

Dense: matrices are square or larger; only the leading n rows and columns are used, and of those only the
upper triangle. For the sizes here, the number of close pairs, this is faster than a library call.

A robot's matrix is

    dᵀMd = Σ_k δp_kᵀ W_k δp_k + Σ_j d_jᵀ B_j d_j + (AᵀDA's five diagonals in ψ and in v),   d_j = (δψ_j, δv_j)

Going back from stage K, what is left of M concerns the next position and the profile of two stages, since
all later positions follow from those: eliminating d_j turns a form in (p_{j+1}, d_j, d_{j−1}) into one in
(p_j, d_{j−1}, d_{j−2}). A row of U is therefore known by eight numbers: its diagonal, its entry for the other
variable of its stage, its pull on the position (an entry a·arm_l for every earlier stage l), and what it adds
for the two stages before.
"""

import math

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.vehicle import Array

WIDTH = 8
"""Numbers a row: own ψ and v, pull in x and y, ψ and v of the stage before, ψ and v of the one before it."""


@kernel
def factorise(matrix: Array, size: int) -> bool:
    """Replace the upper triangle of M by that of U; four rows at a time, so that each is passed over rarely.

    Returns:
        False where M is not positive definite (or not finite); the matrix is then spoiled.
    """
    for first in range(0, size, 4):
        last = min(first + 4, size)
        for row in range(first, last):
            here = matrix[row]
            for above in range(first, row):
                there = matrix[above]
                factor = there[row]
                for column in range(row, size):
                    here[column] -= factor * there[column]
            pivot = here[row]
            if not pivot > 0.0:
                return False
            scale = 1.0 / math.sqrt(pivot)
            for column in range(row, size):
                here[column] *= scale
        if last == first + 4:
            _subtract_four(matrix, first, size)
    return True


@kernel
def _subtract_four(matrix: Array, first: int, size: int) -> None:
    """Take four finished rows out of all rows below them."""
    one, two, three, four = matrix[first], matrix[first + 1], matrix[first + 2], matrix[first + 3]
    for row in range(first + 4, size):
        here = matrix[row]
        a, b, c, d = one[row], two[row], three[row], four[row]
        for column in range(row, size):
            here[column] -= a * one[column] + b * two[column] + c * three[column] + d * four[column]


@kernel
def solve_transposed(factor: Array, size: int, right: Array) -> None:
    """Replace the right-hand side by U⁻ᵀ times it."""
    for row in range(size):
        here = factor[row]
        value = right[row] / here[row]
        right[row] = value
        for column in range(row + 1, size):
            right[column] -= value * here[column]


@kernel
def solve_upper(factor: Array, size: int, right: Array) -> None:
    """Replace the right-hand side by U⁻¹ times it."""
    for row in range(size - 1, -1, -1):
        here = factor[row]
        value = right[row]
        for column in range(row + 1, size):
            value -= here[column] * right[column]
        right[row] = value / here[row]


@kernel
def factorise_stages(jacobian: Array, weights: Array, blocks: Array, bands: Array, factor: Array) -> bool:
    """Find the rows (n, 8) of U.

    Args:
        jacobian: effect of each variable on all later positions, shape (n, 2).
        weights: diagonal of W at each stage, shape (K + 1, 2).
        blocks: B_j as its entries (ψψ, ψv, vv), from stage K to 1, shape (K, 3).
        bands: AᵀDA as ``profiles.limit_bands`` gives it, shape (n, 3).
        factor: where the rows go.

    Returns:
        False where M is not positive definite (or not finite).
    """
    steps = len(jacobian) // 2
    form = np.zeros((WIDTH, WIDTH))  # the upper triangle, in the order of a row
    for slot in range(0, len(jacobian), 2):
        if slot > 0:
            _go_back(form, jacobian[slot : slot + 2], weights[steps - slot // 2 + 1])
        block = blocks[slot // 2]
        form[0, 0] += block[0] + bands[slot, 0]
        form[0, 1] += block[1]
        form[1, 1] += block[2] + bands[slot + 1, 0]
        for c in range(2):
            form[c, 4 + c] += bands[slot + c, 1]
            form[c, 6 + c] += bands[slot + c, 2]
        for c in range(2):
            if not form[c, c] > 0.0:
                return False
            scale = 1.0 / math.sqrt(form[c, c])
            for column in range(WIDTH):
                form[c, column] *= scale
                factor[slot + c, column] = form[c, column]
            factor[slot + c, c] = scale  # one over the diagonal: multiplying is faster than dividing
            for row in range(c + 1, WIDTH):
                for column in range(row, WIDTH):
                    form[row, column] -= form[c, row] * form[c, column]
    return True


@kernel
def _go_back(form: Array, jacobian: Array, weights: Array) -> None:
    """From what an elimination left to the form of the stage before: its profile moves the position."""
    for c in range(2):
        form[2 + c, 2 + c] += weights[c]
    # (p, d₁, d₂) become (p, d, d₁): what was said of the stages before is said of one stage later.
    xx, xy, yy = form[2, 2], form[2, 3], form[3, 3]
    for c in range(2):
        arm_x, arm_y = jacobian[c, 0], jacobian[c, 1]
        on_x, on_y = form[2, 4 + c], form[3, 4 + c]
        form[c, 2] = on_x + arm_x * xx + arm_y * xy
        form[c, 3] = on_y + arm_x * xy + arm_y * yy
        for other in range(c, 2):
            form[c, other] = (
                form[4 + c, 4 + other]
                + arm_x * form[2, 4 + other]
                + arm_y * form[3, 4 + other]
                + form[c, 2] * jacobian[other, 0]
                + form[c, 3] * jacobian[other, 1]
            )
        for before in range(2):
            form[c, 4 + before] = (
                form[4 + c, 6 + before] + arm_x * form[2, 6 + before] + arm_y * form[3, 6 + before]
            )
            form[c, 6 + before] = 0.0
    for row in range(2, 4):
        for before in range(2):
            form[row, 4 + before] = form[row, 6 + before]
            form[row, 6 + before] = 0.0
    for row in range(2):
        for column in range(2):
            form[4 + row, 4 + column] = form[6 + row, 6 + column]
            form[4 + row, 6 + column] = 0.0
            form[6 + row, 6 + column] = 0.0


@kernel
def solve_stages_transposed(factor: Array, jacobian: Array, first: int, right: Array) -> None:
    """Replace the right-hand side (n,) by U⁻ᵀ times it; its entries before ``first`` are zero and stay so."""
    pull_x, pull_y = 0.0, 0.0
    for slot in range(first, len(right), 2):
        for c in range(2):
            here = slot + c
            value = right[here] - jacobian[here, 0] * pull_x - jacobian[here, 1] * pull_y
            if slot >= first + 2:
                value -= factor[slot - 2, 4 + c] * right[slot - 2] + factor[slot - 1, 4 + c] * right[slot - 1]
            if slot >= first + 4:
                value -= factor[slot - 4, 6 + c] * right[slot - 4] + factor[slot - 3, 6 + c] * right[slot - 3]
            if c == 1:
                value -= factor[slot, 1] * right[slot]
            right[here] = value * factor[here, c]
        pull_x += factor[slot, 2] * right[slot] + factor[slot + 1, 2] * right[slot + 1]
        pull_y += factor[slot, 3] * right[slot] + factor[slot + 1, 3] * right[slot + 1]


@kernel
def solve_stages(factor: Array, jacobian: Array, right: Array) -> None:
    """Replace the right-hand side (n,) by U⁻¹ times it."""
    size = len(right)
    x, y = 0.0, 0.0
    for slot in range(size - 2, -1, -2):
        for c in range(1, -1, -1):
            row = factor[slot + c]
            value = right[slot + c] - row[2] * x - row[3] * y
            if slot + 2 < size:
                value -= row[4] * right[slot + 2] + row[5] * right[slot + 3]
            if slot + 4 < size:
                value -= row[6] * right[slot + 4] + row[7] * right[slot + 5]
            if c == 0:
                value -= row[1] * right[slot + 1]
            right[slot + c] = value * row[c]
        x += jacobian[slot, 0] * right[slot] + jacobian[slot + 1, 0] * right[slot + 1]
        y += jacobian[slot, 1] * right[slot] + jacobian[slot + 1, 1] * right[slot + 1]
