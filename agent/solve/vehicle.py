"""The vehicle model of eq. 8 as the robots use it: rollouts, and the inputs that states reveal.

A state is (p_x, p_y, ψ, v), an input is (ω, a); see ``protocol.vehicle`` for units and frames.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


def rollout(state: Array, inputs: Array, step_s: float) -> Array:
    """The present states (..., 4), and those (..., K + 1, 4) that follow from inputs (..., K, 2) (eq. 3)."""
    steps = inputs.shape[-2]
    states = np.empty((*state.shape[:-1], steps + 1, 4))
    states[..., 0, :] = state
    heading_and_speed = state[..., None, 2:] + step_s * np.cumsum(inputs, axis=-2)
    states[..., 1:, 2:] = heading_and_speed
    heading, speed = states[..., :-1, 2], states[..., :-1, 3]
    way = step_s * speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    states[..., 1:, :2] = state[..., None, :2] + np.cumsum(way, axis=-2)
    return states


def velocity(state: Array) -> Array:
    """The velocity (v_x, v_y) of a state, in m/s, shape (2,)."""
    heading, speed = float(state[2]), float(state[3])
    return speed * np.array([math.cos(heading), math.sin(heading)])


def recovered_inputs(states: Array, step_s: float) -> Array:
    """Inputs (..., K, 2) that led through observed states (..., K + 1, 4): ω = Δψ/Δt, a = Δv/Δt.

    Headings must be without jumps by whole turns.
    """
    return np.diff(states[..., 2:], axis=-2) / step_s
