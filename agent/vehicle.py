"""The vehicle model of eq. 8 as the robots use it: rollouts, and how states depend on inputs.

A state is (p_x, p_y, ψ, v), an input is (ω, a); see ``protocol.vehicle`` for units and frames.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


def rollout(state: Array, inputs: Array, step_s: float) -> Array:
    """States that follow from inputs (eq. 3).

    Args:
        state: present states, shape (..., 4).
        inputs: shape (..., K, 2).
        step_s: Δt in s.

    Returns:
        The present and the next K states, shape (..., K + 1, 4).
    """
    steps = inputs.shape[-2]
    states = np.empty((*state.shape[:-1], steps + 1, 4))
    states[..., 0, :] = state
    heading_and_speed = state[..., None, 2:] + step_s * np.cumsum(inputs, axis=-2)
    states[..., 1:, 2:] = heading_and_speed
    heading, speed = states[..., :-1, 2], states[..., :-1, 3]
    way = step_s * speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    states[..., 1:, :2] = state[..., None, :2] + np.cumsum(way, axis=-2)
    return states


def recovered_inputs(states: Array, step_s: float) -> Array:
    """Inputs that led through observed states: ω = Δψ/Δt, a = Δv/Δt.

    Args:
        states: shape (..., K + 1, 4), headings without jumps by whole turns.
        step_s: Δt in s.

    Returns:
        Shape (..., K, 2).
    """
    return np.diff(states[..., 2:], axis=-2) / step_s


def sensitivities(states: Array, step_s: float) -> Array:
    """S_k = ∂x_k/∂U along a trajectory, in closed form.

    A change of ω_m turns everything after p_{m+1} around that point; a change of a_m stretches it.

    Args:
        states: shape (K + 1, 4).
        step_s: Δt in s.

    Returns:
        Shape (K + 1, 4, K, 2): stage, state component, stage of the input, input component.
    """
    steps = len(states) - 1
    result = np.zeros((steps + 1, 4, steps, 2))
    positions, headings = states[:, :2], states[:-1, 2]
    directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    travelled = np.concatenate([np.zeros((1, 2)), np.cumsum(directions, axis=0)])
    for m in range(steps):
        arm = positions[m + 1 :] - positions[m + 1]
        result[m + 1 :, 0, m, 0] = -step_s * arm[:, 1]
        result[m + 1 :, 1, m, 0] = step_s * arm[:, 0]
        result[m + 1 :, :2, m, 1] = step_s**2 * (travelled[m + 1 :] - travelled[m + 1])
        result[m + 1 :, 2, m, 0] = step_s
        result[m + 1 :, 3, m, 1] = step_s
    return result
