"""The filter and smoother beside a textbook implementation with matrices, and beside the truth."""

import math
from typing import Any

import numpy as np
import pytest
from agent_helpers import STEP_S, euler
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.remember.filtering import change_sigmas, first_belief, smooth, unknown_sigmas
from protocol.vehicle import Limits, wrap_angle

LIMITS = Limits()
CHANGES = change_sigmas(LIMITS, STEP_S)
LOW = np.array([0.02, 0.02, math.radians(2.0), 0.05])
"""Two centimetres, two degrees, 5 cm/s."""


def drive(random: np.random.Generator, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """States and the inputs that led to them, (n, 4) and (n, 2); inputs change at random within the rates."""
    changes = random.choice([-1.0, 1.0], (steps, 2)) * [0.05, 0.7]
    inputs = [np.zeros(2)]
    for change in changes:
        inputs.append(np.clip(inputs[-1] + change, [-1.57, -3.0], [1.57, 3.0]))
    start = [random.normal(), random.normal(), random.uniform(-4.0, 4.0), random.uniform(-2.0, 2.0)]
    return euler(start, inputs[1:]), np.array(inputs)


def measured(random: np.random.Generator, states: np.ndarray, sigmas: np.ndarray) -> Any:
    """Values and sigmas as the kernel takes them, inputs unmeasured."""
    values, accuracy = np.zeros((len(states), 6)), np.full((len(states), 6), np.inf)
    values[:, :4] = states + sigmas * random.standard_normal(states.shape)
    values[:, 2] = [wrap_angle(heading) for heading in values[:, 2]]
    accuracy[:, :4] = sigmas
    return values, accuracy


def textbook(mean: Any, covariance: Any, values: Any, sigmas: Any) -> Any:
    """Extended Kalman filter and Rauch–Tung–Striebel smoother, all components at once, with inverses.

    Returns:
        Smoothed means; and, before each measurement, means and covariances.
    """

    def step(z: Any) -> Any:
        x, y, heading, speed, turn_rate, acceleration = z
        return np.array(
            [
                x + STEP_S * speed * math.cos(heading),
                y + STEP_S * speed * math.sin(heading),
                heading + STEP_S * turn_rate,
                speed + STEP_S * acceleration,
                turn_rate,
                acceleration,
            ]
        )

    def slope(z: Any) -> Any:
        h = 1e-6
        return np.array([(step(z + h * e) - step(z - h * e)) / (2 * h) for e in np.eye(6)]).T

    into = np.array([[0, 0], [0, 0], [STEP_S, 0], [0, STEP_S], [1, 0], [0, 1]], dtype=float)
    noise = into @ np.diag(CHANGES**2) @ into.T
    z, p = mean, covariance
    before, after = [(z, p)], []
    for k, (value, sigma) in enumerate(zip(values, sigmas, strict=True)):
        if k > 0:
            f = slope(z)
            z, p = step(z), f @ p @ f.T + noise
            before.append((z, p))
        h = np.eye(6)[np.isfinite(sigma)]
        if len(h):
            misfit = h @ (value - z)
            misfit[h[:, 2] == 1.0] = [wrap_angle(each) for each in misfit[h[:, 2] == 1.0]]
            gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + np.diag((h @ np.where(h.any(0), sigma, 0)) ** 2))
            z, p = z + gain @ misfit, (np.eye(6) - gain @ h) @ p
        after.append((z, p))
    smoothed = [after[-1][0]]
    for (z, p), (ahead, spread) in reversed(list(zip(after[:-1], before[1:], strict=True))):
        gain = p @ slope(z).T @ np.linalg.inv(spread)
        smoothed.insert(0, z + gain @ (smoothed[0] - ahead))
    return np.array(smoothed), *(np.array(each) for each in zip(*before, strict=True))


@settings(max_examples=15)
@given(st.integers(0, 2**32), st.booleans())
def test_it_is_what_the_textbook_computes(seed, knows_inputs):
    """With gaps, with and without measured inputs, across ±π."""
    random = np.random.default_rng(seed)
    states, inputs = drive(random, 20)
    values, sigmas = measured(random, states, LOW)
    if knows_inputs:
        values[:, 4:], sigmas[:, 4:] = inputs, [0.02, 0.05]
    sigmas[1:][random.random(20) < 0.3] = np.inf
    belief = first_belief(values[0, :4], unknown_sigmas(LIMITS))
    found, means, covariances = smooth(*belief, values, sigmas, CHANGES, STEP_S)
    smoothed, predicted, uncertain = textbook(*belief, values, sigmas)
    np.testing.assert_allclose(found, smoothed, atol=2e-5)
    np.testing.assert_allclose(means, predicted, atol=2e-5)
    np.testing.assert_allclose(covariances, uncertain, atol=2e-5)


def test_it_knows_how_far_off_the_truth_it_is():
    """Squared errors over their covariance are six on average, one a component."""
    random, squares = np.random.default_rng(4), []
    for _ in range(40):
        states, inputs = drive(random, 16)
        values, sigmas = measured(random, states, LOW)
        _, means, covariances = smooth(*first_belief(values[0, :4], CHANGES), values, sigmas, CHANGES, STEP_S)
        off = np.append(states[-1], inputs[-1]) - means[-1]
        off[2] = wrap_angle(off[2])
        squares.append(off @ np.linalg.inv(covariances[-1]) @ off)
    assert np.mean(squares) == pytest.approx(6.0, abs=4.0 * math.sqrt(12.0 / 40.0))
