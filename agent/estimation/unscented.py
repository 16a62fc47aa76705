"""The measurement update of an unscented Kalman filter (Julier & Uhlmann 1997).

What a nonlinear function does to a Gaussian is seen from its values at 2n + 1 sigma points. Covariances are
taken about the central point's value, the form in which its authors keep them positive semidefinite however
large n is; in the terms of Merwe's scaled points: α² = β = c/n, κ = 0.
"""

import numpy as np

from agent.vehicle import Array

SPREAD = 3.0
"""c: sigma points lie √c standard deviations away. 3 matches the fourth moments of a Gaussian."""


def sigma_points(mean: Array, covariance: Array) -> Array:
    """The mean, then the points to both sides of it along a root of the covariance.

    Args:
        mean: shape (n,).
        covariance: shape (n, n), positive definite.

    Returns:
        Shape (2n + 1, n).
    """
    away = np.linalg.cholesky(SPREAD * covariance).T
    return np.concatenate([mean[None], mean + away, mean - away])


def updated(points: Array, images: Array, observed: Array, variances: Array) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) once a measurement is known.

    Args:
        points: the sigma points, shape (2n + 1, n).
        images: the measurement that each of them predicts, shape (2n + 1, m).
        observed: the measurement, shape (m,).
        variances: of its independent errors, shape (m,), all positive.
    """
    weight = 0.5 / SPREAD
    away, seen = points[1:] - points[0], images[1:] - images[0]
    expected = images[0] + weight * seen.sum(axis=0)
    cross = weight * away.T @ seen
    innovation = weight * seen.T @ seen + np.diag(variances)
    gain = np.linalg.solve(innovation, cross.T).T
    covariance = weight * away.T @ away - gain @ cross.T
    return points[0] + gain @ (observed - expected), 0.5 * (covariance + covariance.T)
