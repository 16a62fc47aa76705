"""Trajectories as profiles: the headings and speeds of stages 1…K are the variables of a robot.

Inputs are their differences and positions their sums (eq. 8), so every limit of a vehicle is linear in them
and only positions are not. Variables stand in the order ψ_K, v_K, ψ_{K−1}, …, v_1: a position depends on the
profile before its stage, so its gradient begins with zeros, and stays so when a factorisation is applied.

Shapes: M robots, K steps, n = 2K variables a robot. States are (M, K + 1, 4).
"""

import math

import numpy as np

from agent.solve.compiled import kernel
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
