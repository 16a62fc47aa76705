"""What noisy sensors saw of a robot, brought together with how robots move: a Kalman filter and smoother.

The state is (p_x, p_y, ψ, v, ω, a) with the input (ω, a) that led there: constant turn rate and acceleration
(CTRA) in the discrete time of eq. 8, up to changes of the inputs,

    u_k = u_{k−1} + w_k,    x_{k+1} = f(x_k, u_k),    w_k white.

The filter is the extended Kalman filter; measurements are taken in one by one, which for independent errors
is the same and inverts no matrix. The smoother is that of Rauch, Tung and Striebel in the form of Bierman
(1973), "Fixed interval smoothing with discrete measurements", which inverts no covariance: the filter's are
singular, since noise enters positions through headings and speeds only. Headings, speeds and inputs obey
linear equations, so the smoothed ones are consistent: differences of states give the inputs.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.vehicle import Array
from protocol.vehicle import Limits

EXACT = np.full(6, 1e-4)
"""No measurement is taken for more exact than this, in m, rad, m/s, rad/s and m/s²."""
ANYWHERE = np.array([10.0, 10.0, math.pi, 10.0])
"""σ of a state before its first measurement, around the latter."""


class Belief(NamedTuple):
    """A normal distribution of the state."""

    mean: Array
    """Shape (6,)."""
    covariance: Array
    """Shape (6, 6)."""


def first_belief(state: Array, input_sigmas: Array) -> Belief:
    """Before the first measurement of a robot, which then is taken for the state.

    Args:
        state: the measurement, shape (4,).
        input_sigmas: of the input that led there, whose mean is zero, shape (2,).
    """
    sigmas = np.concatenate([ANYWHERE, input_sigmas])
    return Belief(np.concatenate([state, np.zeros(2)]), np.diag(sigmas**2))


def standing_belief(state: Array) -> Belief:
    """Before the first measurement of a robot that is known to stand, and to have stood before."""
    sigmas = np.concatenate([ANYWHERE[:3], EXACT[3:]])
    return Belief(np.concatenate([state[:3], np.zeros(3)]), np.diag(sigmas**2))


def change_sigmas(limits: Limits, step_s: float) -> Array:
    """σ of w, shape (2,): the limits of rates, at which robots change their inputs most of the time."""
    return np.array([limits.turn_acceleration_radps2, limits.jerk_mps3]) * step_s


def unknown_sigmas(limits: Limits) -> Array:
    """σ of an input of which nothing is known, shape (2,): all within the limits are equally likely."""
    return np.array([limits.turn_rate_radps, limits.acceleration_mps2]) / math.sqrt(3.0)


@kernel
def smooth(
    mean: Array, covariance: Array, values: Array, sigmas: Array, changes: Array, step_s: float
) -> tuple[Array, Array, Array]:
    """Filter forwards and smooth backwards over consecutive steps.

    Args:
        mean: of the belief in the first step before its measurement, shape (6,).
        covariance: of the same, shape (6, 6).
        values: measurements, shape (n, 6); headings may be whole turns away.
        sigmas: their standard deviations, shape (n, 6); infinite where nothing was measured.
        changes: σ of w, shape (2,).
        step_s: Δt.

    Returns:
        The smoothed states, shape (n, 6), the last of which is the filtered one; and the beliefs in each
        step before its measurement, shapes (n, 6) and (n, 6, 6).
    """
    count = len(values)
    means, covariances = np.empty((count, 6)), np.empty((count, 6, 6))
    smoothed, spreads = np.empty((count, 6)), np.empty((count, 6, 6))
    gains, misfits = np.zeros((count, 6, 6)), np.zeros((count, 6))
    x, p = mean.copy(), covariance.copy()
    for k in range(count):
        if k > 0:
            _predict(x, p, changes, step_s)
        means[k], covariances[k] = x, p
        _update(x, p, values[k], sigmas[k], gains[k], misfits[k])
        smoothed[k], spreads[k] = x, p
    adjoint = np.zeros(6)
    for k in range(count - 1, -1, -1):
        if k < count - 1:
            _pull(adjoint, smoothed[k], step_s)
            for i in range(6):  # only here the filtered state becomes the smoothed one
                smoothed[k, i] += _dot(spreads[k, i], adjoint)
        for i in range(5, -1, -1):
            adjoint[i] += misfits[k, i] - _dot(gains[k, i], adjoint)
    return smoothed, means, covariances


@kernel
def _predict(x: Array, p: Array, changes: Array, step_s: float) -> None:
    """Bring mean and covariance one step on; w changes an input, and with it the heading or the speed."""
    for _ in range(2):  # P Fᵀ, transposed, and the same again: P is symmetric
        for i in range(6):
            _push(p[i], x, step_s)
        p[:] = p.T.copy()
    x[0] += step_s * x[3] * math.cos(x[2])
    x[1] += step_s * x[3] * math.sin(x[2])
    for j in range(2):
        x[2 + j] += step_s * x[4 + j]
        variance = changes[j] ** 2
        p[2 + j, 2 + j] += step_s**2 * variance
        p[2 + j, 4 + j] += step_s * variance
        p[4 + j, 2 + j] += step_s * variance
        p[4 + j, 4 + j] += variance


@kernel
def _push(change: Array, x: Array, step_s: float) -> None:
    """Bring a small change of a state one step on: F times it."""
    cosine, sine = step_s * math.cos(x[2]), step_s * math.sin(x[2])
    change[0] += cosine * change[3] - x[3] * sine * change[2]
    change[1] += sine * change[3] + x[3] * cosine * change[2]
    for j in range(2):
        change[2 + j] += step_s * change[4 + j]


@kernel
def _pull(adjoint: Array, x: Array, step_s: float) -> None:
    """Bring an adjoint one step back: Fᵀ times it."""
    cosine, sine = step_s * math.cos(x[2]), step_s * math.sin(x[2])
    for j in range(2):
        adjoint[4 + j] += step_s * adjoint[2 + j]
    adjoint[2] += x[3] * (cosine * adjoint[1] - sine * adjoint[0])
    adjoint[3] += cosine * adjoint[0] + sine * adjoint[1]


@kernel
def _update(x: Array, p: Array, values: Array, sigmas: Array, gains: Array, misfits: Array) -> None:
    """Take in the measurements of one step, component by component; ``x`` and ``p`` are changed.

    Args:
        x: mean, shape (6,).
        p: covariance, shape (6, 6).
        values: measurements, shape (6,).
        sigmas: theirs, shape (6,).
        gains: receives the gain of each component, shape (6, 6); the others stay zero.
        misfits: receives each innovation over its variance, shape (6,); the others stay zero.
    """
    for i in range(6):
        if sigmas[i] < np.inf:
            innovation = values[i] - x[i]
            if i == 2:
                innovation -= math.tau * np.round(innovation / math.tau)
            variance = p[i, i] + sigmas[i] ** 2
            misfits[i] = innovation / variance
            for j in range(6):
                gains[i, j] = p[i, j] / variance
            for j in range(6):
                x[j] += gains[i, j] * innovation
                for m in range(6):
                    p[j, m] -= gains[i, j] * gains[i, m] * variance


@kernel
def _dot(one: Array, other: Array) -> float:
    total = 0.0
    for i in range(6):
        total += one[i] * other[i]
    return total
