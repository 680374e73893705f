"""Likelihood of a measured velocity under correct and failed measurements.

A flow source errs in three ways. Its error has the covariance R_d; or it missed the motion and
reports an object at rest; or it reports the velocity of something else. The density of a velocity v
that a track predicts as N(d, P) is

    p_correct N(v; d, P + R_d) + p_missed_motion N(v; 0, R_d) + p_outlier N(v; 0, G + R_d),

with probabilities that sum to one. Where the first term is smaller than the others, the velocity is
left out, so that a moving track is not stopped. Only ratios count, so densities are divided by
p_correct here.

N(d, P) grew from a broad prior N(0, P_0), which leaves next to nothing for standing still; but many
objects do. With the prior probability p_static, the odds that a track stands are

    p_static / (1 - p_static) * N(0; d, P) / N(0; 0, P_0)

(the density ratio of Savage and Dickey), and N(v; 0, R_d) times these odds supports the velocity.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.geometry.two_by_two import density_2x2

SMALLEST = 1e-200
"""Lower bound of a density: a velocity that no term explains is an outlier, not a division by 0."""


def outlier_likelihood(
    velocity: F64, covariance: F64, error_model: VelocityErrorModel, sigma: float
) -> F64:
    """Return the second and third term (n,) for velocities (n, 2) with R_d (n, 2, 2).

    `sigma` is the standard deviation of an outlier, in the unit of the velocities.
    """
    result = np.zeros(len(velocity))
    if error_model.p_missed_motion > 0:
        result += error_model.p_missed_motion * density_2x2(velocity, covariance)
    if error_model.p_outlier > 0:
        spread = covariance + sigma**2 * np.eye(2)
        result += error_model.p_outlier * density_2x2(velocity, spread)
    p_correct = 1.0 - error_model.p_missed_motion - error_model.p_outlier
    return np.maximum(result / p_correct, SMALLEST if p_correct < 1.0 else 0.0)


def static_odds(mean: F64, covariance: F64, prior: F64, p_static: float) -> F64:
    """Return the odds (n,) that tracks with velocities N(mean, covariance) stand still.

    `mean` (n, 2), `covariance` (n, 2, 2); `prior` (n, 2, 2) is the covariance of a new track's
    velocity and `p_static` < 1 the probability of standing before any observation.
    """
    ratio = density_2x2(mean, covariance) / density_2x2(np.zeros_like(mean), prior)
    return p_static / (1.0 - p_static) * ratio
