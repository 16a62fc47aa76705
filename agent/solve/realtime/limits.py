"""The limits of a vehicle (eq. 9) as linear rows in its variables, and their transposes.

Rows of one robot, 5K of them: ω_0 … ω_{K−1}, a_0 … a_{K−1}; then their changes from one step to the next;
then v_1 … v_K. All of them are differences of neighbouring variables: row times variables takes a few
operations, and the matrix AᵀDA has five diagonals in ψ and five in v.
"""

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.problem import LIMITED_QUANTITIES
from agent.solve.vehicle import Array


@kernel
def apply_limits(change: Array, step_s: float, rows: Array) -> None:
    """A d: how a change (n,) of the variables changes the limited quantities (5K,)."""
    steps = len(change) // 2
    for c in range(2):
        before, rate_before = 0.0, 0.0
        for k in range(steps):
            here = change[2 * (steps - k - 1) + c]
            rate = (here - before) / step_s
            rows[c * steps + k] = rate
            rows[(2 + c) * steps + k] = rate - rate_before
            before, rate_before = here, rate
    for k in range(steps):
        rows[4 * steps + k] = change[2 * (steps - k - 1) + 1]


@kernel
def add_transposed_limits(rows: Array, step_s: float, result: Array) -> None:
    """Add Aᵀ y for y of shape (5K,) to a gradient (n,)."""
    steps = len(result) // 2
    for c in range(2):
        for k in range(steps):
            here = rows[c * steps + k] + rows[(2 + c) * steps + k]
            if k + 1 < steps:
                here -= rows[(2 + c) * steps + k + 1]
            here /= step_s
            slot = 2 * (steps - k - 1) + c
            result[slot] += here
            if k > 0:
                result[slot + 2] -= here
    for k in range(steps):
        result[2 * (steps - k - 1) + 1] += rows[4 * steps + k]


@kernel
def limit_bands(weights: Array, step_s: float, bands: Array) -> None:
    """Set the bands (n, 3) to AᵀDA, D = diag(weights).

    Its entries of a variable with itself, with that of the stage before and with that of the one before it.
    """
    steps = len(bands) // 2
    scale = 1.0 / step_s**2
    bands[:] = 0.0
    for c in range(2):
        for k in range(steps):
            slot = 2 * (steps - k - 1) + c
            once, twice = scale * weights[c * steps + k], scale * weights[(2 + c) * steps + k]
            bands[slot, 0] += once + twice
            if k > 0:
                bands[slot + 2, 0] += once + 4.0 * twice
                bands[slot, 1] -= once + 2.0 * twice
            if k > 1:
                bands[slot + 4, 0] += twice
                bands[slot, 2] += twice
                bands[slot + 2, 1] -= 2.0 * twice
    for k in range(steps):
        bands[2 * (steps - k - 1) + 1, 0] += weights[4 * steps + k]


@kernel
def limited_quantities(path: Array, previous_input: Array, step_s: float, rows: Array) -> None:
    """The limited quantities (5K,) themselves, of the states (K + 1, 4) of one robot."""
    steps = len(path) - 1
    for c in range(2):
        before = previous_input[c]
        for k in range(steps):
            here = (path[k + 1, 2 + c] - path[k, 2 + c]) / step_s
            rows[c * steps + k] = here
            rows[(2 + c) * steps + k] = here - before
            before = here
    for k in range(steps):
        rows[4 * steps + k] = path[k + 1, 3]


@kernel
def bounds_of(input_bounds: Array, rate_bounds: Array, speed_bound: float, steps: int) -> Array:
    """The largest size (5K,) of each limited quantity of one robot."""
    bounds = np.empty(LIMITED_QUANTITIES * steps)
    for c in range(2):
        bounds[c * steps : (c + 1) * steps] = input_bounds[c]
        bounds[(2 + c) * steps : (3 + c) * steps] = rate_bounds[c]
    bounds[4 * steps :] = speed_bound
    return bounds
