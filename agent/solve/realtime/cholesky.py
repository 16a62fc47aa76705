"""Dense factorisation M = UᵀU of small positive definite matrices, and triangular solves with it.

Matrices are square or larger; only the leading n rows and columns are used, and of those only the upper
triangle. For the sizes here, the number of close pairs, this is faster than a library call.
"""

import math

from agent.solve.compiled import kernel
from agent.solve.vehicle import Array


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
