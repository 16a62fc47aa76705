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
        Smoothed means and covariances.
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
    smoothed = [after[-1]]
    for k in range(len(after) - 2, -1, -1):
        (z, p), (ahead, spread) = after[k], before[k + 1]
        gain = p @ slope(z).T @ np.linalg.inv(spread)
        later, later_spread = smoothed[0]
        smoothed.insert(0, (z + gain @ (later - ahead), p + gain @ (later_spread - spread) @ gain.T))
    return [np.array(each) for each in zip(*smoothed, strict=True)]


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
    expected, _ = textbook(*belief, values, sigmas)
    np.testing.assert_allclose(found, expected, atol=2e-5)
    np.testing.assert_array_equal(means[0], belief.mean)
    np.testing.assert_array_equal(covariances[0], belief.covariance)


@settings(max_examples=15)
@given(st.integers(0, 2**32))
def test_a_window_that_moves_on_says_the_same_and_differences_of_states_are_inputs(seed):
    """The same of the present as all measurements."""
    random = np.random.default_rng(seed)
    values, sigmas = measured(random, drive(random, 30)[0], LOW)
    belief = first_belief(values[0, :4], CHANGES)
    found, means, covariances = smooth(*belief, values, sigmas, CHANGES, STEP_S)
    later = smooth(means[9], covariances[9], values[9:], sigmas[9:], CHANGES, STEP_S)[0]
    np.testing.assert_allclose(later, found[9:], atol=1e-9)
    np.testing.assert_allclose(np.diff(found[:, 2:4], axis=0) / STEP_S, found[1:, 4:], atol=1e-9)


def test_it_is_nearer_to_the_truth_than_what_was_measured_and_knows_how_far_off_it_is():
    """The smoother nearer still; squared errors over their covariance are six on average, one a component."""
    random = np.random.default_rng(4)
    raw, filtered, smoothed, squares = [], [], [], []
    for _ in range(40):
        states, inputs = drive(random, 30)
        values, sigmas = measured(random, states, LOW)
        belief = first_belief(values[0, :4], CHANGES)
        found, means, covariances = smooth(*belief, values, sigmas, CHANGES, STEP_S)
        last = smooth(*belief, values[:16], sigmas[:16], CHANGES, STEP_S)[0][-1]
        for errors, state in ((raw, values[15]), (filtered, last), (smoothed, found[15])):
            errors.append(state[:4] - states[15])
            errors[-1][2] = wrap_angle(errors[-1][2])
        off = np.append(states[15], inputs[15]) - means[15]
        off[2] = wrap_angle(off[2])
        squares.append(off @ np.linalg.inv(covariances[15]) @ off)
    measured_m, filtered_m, smoothed_m = (
        np.sqrt(np.mean(np.square(each), axis=0)) for each in (raw, filtered, smoothed)
    )
    assert np.all(filtered_m < [0.7, 0.7, 0.8, 0.95] * measured_m)
    assert np.all(smoothed_m < filtered_m)
    assert np.mean(squares) == pytest.approx(6.0, abs=4.0 * math.sqrt(12.0 / 40.0))
