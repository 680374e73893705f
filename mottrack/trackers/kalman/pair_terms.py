"""Mahalanobis distance and likelihood of listed pairs of detection and track, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.geometry.angles import modulo_pi
from mottrack.geometry.two_by_two import (
    LOG_2_PI,
    Symmetric,
    block_of,
    determinant_of,
    inverse_quadratic_of,
    row_times_inverse,
    sum_of,
)
from mottrack.trackers.kalman.state import YAW
from mottrack.trackers.velocity_source.failures import (
    SMALLEST,
    Failures,
    missed_share,
    normal_density,
)


class Observed(NamedTuple):
    """What the kernel reads of `Detections`; the same names and shapes."""

    box: F64
    xy_covariance: F64
    z_yaw_size_variance: F64
    velocity: F64
    velocity_covariance: F64
    has_velocity: Mask
    likelihood_at_rest: F64
    outlier_likelihood: F64
    standing_likelihood: F64
    clutter_likelihood: F64


class Expected(NamedTuple):
    """What the kernel reads of `Predicted`; the same names and shapes."""

    mean: F64
    xy_velocity_covariance: F64
    z_yaw_size_variance: F64
    place: F64
    spread: F64
    p_standing: F64


class Compared(NamedTuple):
    """Numbers that count beside x and y."""

    first: int
    end: int
    """The box's numbers from `first` up to `end`."""
    velocity_limit: float
    """What a velocity adds to the squared distance at most; below 0 it is not compared."""
    failures: Failures
    """How velocities err."""


@compiled
def pair_terms(
    pairs: tuple[I64, I64], seen: Observed, tracks: Expected, compared: Compared
) -> tuple[F64, F64]:
    """Return r' S^-1 r and -2 ln p(o_hat | track) + 2 ln p(d | clutter) of each pair, (P,) twice.

    S = H P H' + R is taken block by block: (x, y), the other compared numbers of the box, and where
    a velocity was measured (d_x, d_y) given (x, y). In the likelihood the velocity is that of an
    object that stands, or of a mover correct or a failure of its source (`standing`), so a velocity
    that only this track explains supports the pair, and a mover does not take a parked car. The
    position is judged by the filter alone: the place would claim what passes a parked car.
    """
    rows, columns = pairs
    box, mean, failures = seen.box, tracks.mean, compared.failures
    squared, nll = np.empty(len(rows)), np.empty(len(rows))
    for p in range(len(rows)):
        i, j = rows[p], columns[p]
        expected = block_of(tracks.xy_velocity_covariance, j, 0)
        s = sum_of(expected, block_of(seen.xy_covariance, i, 0))
        x, y = box[i, 0] - mean[j, 0], box[i, 1] - mean[j, 1]
        squared[p] = inverse_quadratic_of(s, x, y)
        for k in range(compared.first, compared.end):
            difference = box[i, k] - mean[j, k]
            if k == YAW:
                difference = modulo_pi(difference)
            variance = tracks.z_yaw_size_variance[j, k - 2] + seen.z_yaw_size_variance[i, k - 2]
            squared[p] += difference**2 / variance
        nll[p] = squared[p] + 2.0 * LOG_2_PI + np.log(determinant_of(s))
        if compared.velocity_limit >= 0.0 and seen.has_velocity[i]:
            added, spread = _velocity_terms(seen, tracks, (i, j), s)
            density = np.exp(-0.5 * added) / (2.0 * np.pi * np.sqrt(spread))
            own = block_of(tracks.xy_velocity_covariance, j, 2)
            p_missed = missed_share(failures, mean[j, 7], mean[j, 8], own)
            failed = p_missed * seen.likelihood_at_rest[i] + seen.outlier_likelihood[i]
            moves = (1.0 - failures.p_outlier - p_missed) * density + failed
            q = _standing_there(seen, tracks, (i, j), normal_density(x, y, s))
            likelihood = max(q * seen.standing_likelihood[i] + (1.0 - q) * moves, SMALLEST)
            nll[p] += 2.0 * np.log(seen.clutter_likelihood[i] / likelihood)
            squared[p] += min(added, compared.velocity_limit)
    return squared, nll


@compiled
def _standing_there(seen: Observed, tracks: Expected, pair: tuple[int, int], moves: float) -> float:
    """Return the probability that the track of a pair stands, if it is at the detection.

    `moves` is the density of the position under the filter.
    """
    i, j = pair
    p = tracks.p_standing[j]
    if p == 0.0:
        return 0.0
    x, y = seen.box[i, 0] - tracks.place[j, 0], seen.box[i, 1] - tracks.place[j, 1]
    spread = sum_of(block_of(tracks.spread, j, 0), block_of(seen.xy_covariance, i, 0))
    stands = p * normal_density(x, y, spread)
    return float(stands / max(stands + (1.0 - p) * moves, SMALLEST))


@compiled
def _velocity_terms(
    seen: Observed, tracks: Expected, pair: tuple[int, int], s: Symmetric
) -> tuple[float, float]:
    """Return r' S^-1 r and det S of the velocity given the centre, whose S is `s`."""
    i, j = pair
    x, y = seen.box[i, 0] - tracks.mean[j, 0], seen.box[i, 1] - tracks.mean[j, 1]
    p = tracks.xy_velocity_covariance
    x_x, x_y = row_times_inverse(p[j, 2, 0], p[j, 2, 1], s)
    y_x, y_y = row_times_inverse(p[j, 3, 0], p[j, 3, 1], s)
    r_x = seen.velocity[i, 0] - (tracks.mean[j, 7] + x_x * x + x_y * y)
    r_y = seen.velocity[i, 1] - (tracks.mean[j, 8] + y_x * x + y_y * y)
    whole = sum_of(block_of(p, j, 2), block_of(seen.velocity_covariance, i, 0))
    given = Symmetric(
        whole.xx - (x_x * p[j, 0, 2] + x_y * p[j, 1, 2]),
        whole.xy - (x_x * p[j, 0, 3] + x_y * p[j, 1, 3]),
        whole.yy - (y_x * p[j, 0, 3] + y_y * p[j, 1, 3]),
    )
    return inverse_quadratic_of(given, r_x, r_y), determinant_of(given)
