"""The cost of eq. 11 in the variables of ``profiles``: value, gradient and a positive definite Hessian."""

import math

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.realtime.profiles import pull_back
from agent.solve.vehicle import Array

LEAST_CURVATURE = 5e-5
"""Smallest eigenvalue of the part of the Hessian that belongs to a stage's heading and speed."""


@kernel
def cost_of(states: Array, goals: Array, weights: Array) -> float:
    """Σ_i Σ_k (x_k − L)ᵀ Q_k (x_k − L)."""
    total = 0.0
    for robot in range(len(states)):
        for k in range(states.shape[1]):
            for component in range(4):
                total += weights[k, component] * (states[robot, k, component] - goals[robot, component]) ** 2
    return total


@kernel
def gradient_of(states: Array, goals: Array, weights: Array, jacobian: Array) -> Array:
    """Gradient of the cost, shape (M, n)."""
    robots, steps = states.shape[0], states.shape[1] - 1
    result = np.zeros((robots, 2 * steps))
    pull = np.empty((steps + 1, 2))
    for robot in range(robots):
        for k in range(steps + 1):
            slot = 2 * (steps - k)
            for c in range(2):
                pull[k, c] = 2.0 * weights[k, c] * (states[robot, k, c] - goals[robot, c])
                if k > 0:
                    off = states[robot, k, 2 + c] - goals[robot, 2 + c]
                    result[robot, slot + c] = 2.0 * weights[k, 2 + c] * off
        pull_back(jacobian[robot], pull, result[robot])
    return result


@kernel
def blocks_of(states: Array, goals: Array, weights: Array, forces: Array, step_s: float) -> Array:
    """The part of the Hessian that belongs to each stage's heading and speed, shape (M, K, 3), K to 1.

    The whole Hessian of the Lagrangian is taken as Σ_k (∂p_k)ᵀ 2Q ∂p_k, which is Gauss–Newton in the
    positions, and one block in (ψ_j, v_j) a stage: the cost of heading and speed, and the exact second
    derivative of that stage's step of the model, weighted by the costate of the position after it. Blocks are
    projected onto the positive definite ones. The curvature of the distances is left out: it is negative.

    Args:
        states: shape (M, K + 1, 4).
        goals: L, shape (M, 4).
        weights: diagonal of Q at each stage, shape (K + 1, 4).
        forces: constraint forces on the positions, shape (M, K + 1, 2); they belong to the costates.
        step_s: Δt.
    """
    robots, steps = states.shape[0], states.shape[1] - 1
    result = np.empty((robots, steps, 3))
    for robot in range(robots):
        costate_x, costate_y = 0.0, 0.0
        for j in range(steps, 0, -1):
            heading, speed = states[robot, j, 2], states[robot, j, 3]
            along_x, along_y = math.cos(heading), math.sin(heading)
            turning = -step_s * speed * (costate_x * along_x + costate_y * along_y)
            mixed = step_s * (costate_y * along_x - costate_x * along_y)
            block = _projected(turning + 2.0 * weights[j, 2], mixed, 2.0 * weights[j, 3])
            result[robot, steps - j, 0], result[robot, steps - j, 1], result[robot, steps - j, 2] = block
            costate_x += 2.0 * weights[j, 0] * (states[robot, j, 0] - goals[robot, 0]) - forces[robot, j, 0]
            costate_y += 2.0 * weights[j, 1] * (states[robot, j, 1] - goals[robot, 1]) - forces[robot, j, 1]
    return result


@kernel
def _projected(a: float, b: float, d: float) -> tuple[float, float, float]:
    """The symmetric matrix [[a, b], [b, d]] with its eigenvalues raised to at least ``LEAST_CURVATURE``."""
    middle, half = 0.5 * (a + d), 0.5 * (a - d)
    radius = math.hypot(half, b)
    high, low = middle + radius, middle - radius
    if low >= LEAST_CURVATURE:
        return a, b, d
    if radius <= 0.0:
        return LEAST_CURVATURE, 0.0, LEAST_CURVATURE
    raised_high, raised_low = max(high, LEAST_CURVATURE), LEAST_CURVATURE
    new_middle, scale = 0.5 * (raised_high + raised_low), 0.5 * (raised_high - raised_low) / radius
    return new_middle + scale * half, scale * b, new_middle - scale * half
