"""Mahalanobis distance and likelihood of listed pairs of detection and track, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.geometry.two_by_two import (
    LOG_2_PI,
    determinant_of,
    inverse_quadratic_of,
    row_times_inverse,
)
from mottrack.trackers.kalman.standing import SMALLEST, normal_density
from mottrack.trackers.kalman.state import YAW


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
    p_correct: F64
    p_missed: F64
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
    box, mean = seen.box, tracks.mean
    squared, nll = np.empty(len(rows)), np.empty(len(rows))
    for p in range(len(rows)):
        i, j = rows[p], columns[p]
        s = tracks.xy_velocity_covariance[j][:2, :2] + seen.xy_covariance[i]
        offset = box[i, :2] - mean[j, :2]
        squared[p] = inverse_quadratic_of(s, offset[0], offset[1])
        for k in range(compared.first, compared.end):
            difference = box[i, k] - mean[j, k]
            if k == YAW:
                difference = _modulo_pi(difference)
            variance = tracks.z_yaw_size_variance[j, k - 2] + seen.z_yaw_size_variance[i, k - 2]
            squared[p] += difference**2 / variance
        nll[p] = squared[p] + 2.0 * LOG_2_PI + np.log(determinant_of(s))
        if compared.velocity_limit >= 0.0 and seen.has_velocity[i]:
            added, spread = _velocity_terms(seen, tracks, (i, j), s)
            density = np.exp(-0.5 * added) / (2.0 * np.pi * np.sqrt(spread))
            failed = tracks.p_missed[j] * seen.likelihood_at_rest[i] + seen.outlier_likelihood[i]
            moves = tracks.p_correct[j] * density + failed
            q = _standing_there(seen, tracks, (i, j), normal_density(offset[0], offset[1], s))
            likelihood = max(q * seen.standing_likelihood[i] + (1.0 - q) * moves, SMALLEST)
            nll[p] += 2.0 * np.log(seen.clutter_likelihood[i] / likelihood)
            squared[p] += min(added, compared.velocity_limit)
    return squared, nll


@compiled
def _standing_there(
    seen: Observed, tracks: Expected, pair: tuple[int, int], moves: float
) -> float:
    """Return the probability that the track of a pair stands, if it is at the detection.

    `moves` is the density of the position under the filter.
    """
    i, j = pair
    p = tracks.p_standing[j]
    if p == 0.0:
        return 0.0
    x, y = seen.box[i, 0] - tracks.place[j, 0], seen.box[i, 1] - tracks.place[j, 1]
    stands = p * normal_density(x, y, tracks.spread[j] + seen.xy_covariance[i])
    return float(stands / max(stands + (1.0 - p) * moves, SMALLEST))


@compiled
def _velocity_terms(
    seen: Observed, tracks: Expected, pair: tuple[int, int], s: F64
) -> tuple[float, float]:
    """Return r' S^-1 r and det S of the velocity given the centre, whose S is `s` (2, 2)."""
    i, j = pair
    offset = seen.box[i, :2] - tracks.mean[j, :2]
    covariance = tracks.xy_velocity_covariance[j]
    given = covariance[2:, 2:] + seen.velocity_covariance[i]
    r = np.empty(2)
    for k in range(2):
        gain_x, gain_y = row_times_inverse(covariance[k + 2, :2], s)
        expected = tracks.mean[j, k + 7] + gain_x * offset[0] + gain_y * offset[1]
        r[k] = seen.velocity[i, k] - expected
        for c in range(2):
            given[k, c] -= gain_x * covariance[0, c + 2] + gain_y * covariance[1, c + 2]
    return inverse_quadratic_of(given, r[0], r[1]), determinant_of(given)


@compiled
def _modulo_pi(angle: float) -> float:
    """Return the angle in [-pi/2, pi/2): front and rear of a box look alike."""
    return float((angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
