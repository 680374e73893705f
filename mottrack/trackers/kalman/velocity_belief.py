"""How far a measured velocity is to be believed.

A flow source errs in three ways. Its error has the covariance R_d; or it did not see the motion
and reports an object at rest; or it reports something else's velocity. The density of a velocity v
that a track expects as N(d, P) is

    sound N(v; d, P + R_d) + lost N(v; 0, R_d) + gross N(v; 0, G + R_d),

with shares that sum to one. Where the first term is the smaller part of it, the velocity is no
news of the object, and a moving one is not stopped. Only ratios count, so densities are taken over
the sound share here.

N(d, P) grew from a broad prior N(0, P_0), which leaves next to nothing for standing still; but
many objects do. With the `rest` probability of that, the odds that a track stands, given where
it was seen, are

    rest / (1 - rest) * N(0; d, P) / N(0; 0, P_0)

(the density ratio of Savage and Dickey), and N(v; 0, R_d) times these odds speaks for the velocity.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.geometry.two_by_two import determinant_2x2, inverse_2x2, quadratic_2x2

SMALLEST = 1e-200
"""What no term explains is a failure, not a rounding to 0."""


def density(residual: F64, covariance: F64) -> F64:
    """Normal density (n,) of residuals (n, 2) with covariances (n, 2, 2)."""
    squared = quadratic_2x2(inverse_2x2(covariance), residual)
    return np.asarray(np.exp(-0.5 * squared) / (2 * np.pi * np.sqrt(determinant_2x2(covariance))))


def failure_density(
    velocity: F64, covariance: F64, error_model: VelocityErrorModel, gross: float
) -> F64:
    """The second and the third term for velocities (n, 2) with R_d (n, 2, 2), over sound, (n,).

    `gross` is the standard deviation of a gross velocity, in the unit of the velocities.
    """
    result = np.zeros(len(velocity))
    if error_model.p_missed_motion > 0:
        result += error_model.p_missed_motion * density(velocity, covariance)
    if error_model.p_outlier > 0:
        spread = covariance + gross**2 * np.eye(2)
        result += error_model.p_outlier * density(velocity, spread)
    sound_share = 1.0 - error_model.p_missed_motion - error_model.p_outlier
    return np.maximum(result / sound_share, SMALLEST if sound_share < 1.0 else 0.0)


def rest_odds(mean: F64, covariance: F64, prior: F64, rest: float) -> F64:
    """Odds (n,) that tracks with velocities N(mean (n, 2), covariance (n, 2, 2)) stand still.

    `prior` (n, 2, 2) is the covariance with which they began, `rest` < 1 the probability
    that they stand, before anything was seen.
    """
    shrunk = density(mean, covariance) / density(np.zeros_like(mean), prior)
    return np.asarray(rest / (1.0 - rest) * shrunk)
