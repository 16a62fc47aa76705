"""The unscented update: the Kalman filter where that is exact, a maintained library's where it is not."""

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.estimate.kalman_filter import SPREAD, sigma_points, updated
from agent.solve.vehicle import Array

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 16)


def gaussian(random: np.random.Generator, size: int) -> tuple[Array, Array]:
    root = random.normal(size=(size, size)) + 2.0 * np.eye(size)
    return random.normal(size=size), root @ root.T


@given(seeds, sizes, sizes)
def test_of_a_linear_measurement_it_is_the_kalman_filter(seed, size, measured):
    random = np.random.default_rng(seed)
    mean, covariance = gaussian(random, size)
    matrix, offset = random.normal(size=(measured, size)), random.normal(size=measured)
    observed, variances = random.normal(size=measured), random.uniform(0.1, 2.0, measured)
    points = sigma_points(mean, covariance)
    found, left = updated(points, points @ matrix.T + offset, observed, variances)
    information = np.linalg.inv(covariance) + matrix.T / variances @ matrix
    right = np.linalg.solve(covariance, mean) + matrix.T / variances @ (observed - offset)
    np.testing.assert_allclose(found, np.linalg.solve(information, right), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(left, np.linalg.inv(information), rtol=1e-5, atol=1e-6)


@settings(max_examples=30)
@given(seeds, sizes)
def test_of_a_bent_measurement_it_is_that_of_filterpy(seed, size):
    random = np.random.default_rng(seed)
    mean, covariance = gaussian(random, size)
    matrix = random.normal(size=(size, size))

    def measure(state: Array) -> Array:
        return np.tanh(matrix @ state) + 0.1 * state**2

    observed, variances = random.normal(size=size), random.uniform(0.1, 2.0, size)
    points = sigma_points(mean, covariance)
    found, left = updated(points, np.array([measure(point) for point in points]), observed, variances)
    library = UnscentedKalmanFilter(
        size,
        size,
        dt=1.0,
        hx=measure,
        fx=lambda state, _: state,
        points=MerweScaledSigmaPoints(size, alpha=np.sqrt(SPREAD / size), beta=SPREAD / size, kappa=0.0),
    )
    library.x, library.P = mean, covariance
    library.sigmas_f = library.points_fn.sigma_points(mean, covariance)
    library.update(observed, R=np.diag(variances))
    np.testing.assert_allclose(found, library.x, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(left, library.P, rtol=1e-6, atol=1e-6)


@given(seeds, sizes)
def test_the_covariance_stays_positive_semidefinite_whatever_is_measured(seed, size):
    random = np.random.default_rng(seed)
    points = sigma_points(*gaussian(random, size))
    images = 10.0 * random.normal(size=(len(points), 3))
    _, left = updated(points, images, random.normal(size=3), np.full(3, 1e-3))
    assert np.linalg.eigvalsh(left).min() > -1e-6 * np.linalg.eigvalsh(left).max()


def test_the_points_lie_about_the_mean_and_have_its_covariance():
    mean, covariance = gaussian(np.random.default_rng(1), 5)
    points = sigma_points(mean, covariance)
    assert points.shape == (11, 5)
    np.testing.assert_allclose(points[0], mean)
    np.testing.assert_allclose(points.mean(axis=0), mean)
    away = points[1:] - mean
    np.testing.assert_allclose(away.T @ away / (2.0 * SPREAD), covariance)
