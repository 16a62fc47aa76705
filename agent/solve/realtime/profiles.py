"""Trajectories as profiles: the headings and speeds of stages 1…K are the variables of a robot.

Inputs are their differences and positions their sums (eq. 8), so every limit of a vehicle is linear in them
and only positions are not. Variables stand in the order ψ_K, v_K, ψ_{K−1}, …, v_1: a position depends on the
profile before its stage, so its gradient begins with zeros, and stays so when a factorisation is applied.

The limits of a vehicle (eq. 9) are 5K rows A d: ω_0 … ω_{K−1}, a_0 … a_{K−1}; then their changes from one
step to the next; then v_1 … v_K. All of them are differences of neighbouring variables: A times variables
takes a few operations, and the matrix AᵀDA has five diagonals in ψ and five in v.

Shapes: M robots, K steps, n = 2K variables a robot. States are (M, K + 1, 4).
"""

import math

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.problem import LIMITED_QUANTITIES
from agent.solve.vehicle import Array


@kernel
def drive_profile(states: Array, step_s: float) -> None:
    """Fill in the positions that follow from the headings and speeds of all stages (eq. 8)."""
    for path in states:
        for k in range(len(path) - 1):
            path[k + 1, 0] = path[k, 0] + step_s * path[k, 3] * math.cos(path[k, 2])
            path[k + 1, 1] = path[k, 1] + step_s * path[k, 3] * math.sin(path[k, 2])


@kernel
def states_of(start: Array, inputs: Array, step_s: float) -> Array:
    """The states (M, K + 1, 4) that follow from the present ones (M, 4) and inputs (M, K, 2)."""
    robots, steps = inputs.shape[:2]
    states = np.empty((robots, steps + 1, 4))
    states[:, 0] = start
    for robot in range(robots):
        for k in range(steps):
            states[robot, k + 1, 2:] = states[robot, k, 2:] + step_s * inputs[robot, k]
    drive_profile(states, step_s)
    return states


@kernel
def inputs_of(states: Array, step_s: float) -> Array:
    """The inputs (M, K, 2) that led through states."""
    return (states[:, 1:, 2:] - states[:, :-1, 2:]) / step_s


@kernel
def moved(states: Array, change: Array, share: float, step_s: float) -> Array:
    """The states after a share of a change (M, n) of the variables."""
    result = states.copy()
    steps = states.shape[1] - 1
    for robot in range(len(states)):
        for k in range(1, steps + 1):
            slot = 2 * (steps - k)
            result[robot, k, 2] += share * change[robot, slot]
            result[robot, k, 3] += share * change[robot, slot + 1]
    drive_profile(result, step_s)
    return result


@kernel
def jacobian_of(states: Array, step_s: float) -> Array:
    """How each variable moves all later positions: ∂p_k/∂ψ_j and ∂p_k/∂v_j for any k > j, shape (M, n, 2).

    A position is a sum of v (cos ψ, sin ψ) Δt, so stage j has the same effect on all positions after it.
    """
    robots, steps = states.shape[0], states.shape[1] - 1
    jacobian = np.empty((robots, 2 * steps, 2))
    for robot in range(robots):
        for j in range(1, steps + 1):
            slot = 2 * (steps - j)
            heading, speed = states[robot, j, 2], states[robot, j, 3]
            along_x, along_y = step_s * math.cos(heading), step_s * math.sin(heading)
            jacobian[robot, slot, 0] = -speed * along_y
            jacobian[robot, slot, 1] = speed * along_x
            jacobian[robot, slot + 1, 0] = along_x
            jacobian[robot, slot + 1, 1] = along_y
    return jacobian


@kernel
def displacements(jacobian: Array, change: Array, result: Array) -> None:
    """First-order change (K + 1, 2) of one robot's positions under a change (n,) of its variables."""
    steps = len(result) - 1
    x, y = 0.0, 0.0
    result[0] = 0.0
    result[1] = 0.0
    for k in range(2, steps + 1):
        slot = 2 * (steps - k + 1)
        for each in (slot, slot + 1):
            x += jacobian[each, 0] * change[each]
            y += jacobian[each, 1] * change[each]
        result[k, 0] = x
        result[k, 1] = y


@kernel
def pull_back(jacobian: Array, forces: Array, result: Array) -> None:
    """Add to a gradient (n,) in one robot's variables that of Σ_k forces_kᵀ p_k, forces (K + 1, 2).

    The transpose of :func:`displacements`.
    """
    steps = len(forces) - 1
    x, y = 0.0, 0.0
    for j in range(steps - 1, 0, -1):
        x += forces[j + 1, 0]
        y += forces[j + 1, 1]
        slot = 2 * (steps - j)
        for each in (slot, slot + 1):
            result[each] += jacobian[each, 0] * x + jacobian[each, 1] * y


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
