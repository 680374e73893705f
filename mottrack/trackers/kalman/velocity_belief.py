"""How far a measured velocity is to be believed.

A flow source errs in three ways. Its error has the covariance R_d; or it did not see the motion
and reports an object at rest; or it reports something else's velocity. The density of a velocity v
that a track expects as N(d, P) is

    sound N(v; d, P + R_d) + lost N(v; 0, R_d) + gross N(v; 0, G + R_d),

with shares that sum to one. Where the first term is the smaller part of it, the velocity is no
news of the object: a parked car loses nothing by that, and a moving one is not stopped. Only ratios
count, so densities are taken over the sound share here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mottrack.core.faults import VelocityFaults
from mottrack.trackers.kalman.two_by_two import determinant_2x2, inverse_2x2, quadratic_2x2

F64 = NDArray[np.float64]
SMALLEST = 1e-200
"""What no term explains is a failure, not a rounding to 0."""


def density(residual: F64, covariance: F64) -> F64:
    """Normal density (n,) of residuals (n, 2) with covariances (n, 2, 2)."""
    squared = quadratic_2x2(inverse_2x2(covariance), residual)
    return np.asarray(np.exp(-0.5 * squared) / (2 * np.pi * np.sqrt(determinant_2x2(covariance))))


def failure_density(velocity: F64, covariance: F64, faults: VelocityFaults, gross: float) -> F64:
    """The second and the third term for velocities (n, 2) with R_d (n, 2, 2), over sound, (n,).

    `gross` is the standard deviation of a gross velocity, in the unit of the velocities.
    """
    result = np.zeros(len(velocity))
    if faults.lost_share > 0:
        result += faults.lost_share * density(velocity, covariance)
    if faults.gross_share > 0:
        spread = covariance + gross**2 * np.eye(2)
        result += faults.gross_share * density(velocity, spread)
    sound_share = 1.0 - faults.lost_share - faults.gross_share
    return np.maximum(result / sound_share, SMALLEST if sound_share < 1.0 else 0.0)
