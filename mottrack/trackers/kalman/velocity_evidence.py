"""What the velocities of tracks tell of their source, summed while the tracks are followed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.trackers.kalman.standing import (
    SMALLEST,
    Failures,
    Observation,
    isotropic_density,
    missed_share,
    normal_density,
)

GAIN_SPREAD = 0.2
"""Standard deviation of the gain about 1 before any velocity, and of a velocity about the gain."""
WIDEST = 1e4
"""Variance beyond which an axis was not measured, such as that across the beam of a radar."""


class Evidence(NamedTuple):
    """Sums over velocities, which the kernel adds to."""

    log_scale: F64
    """(2,) of R, of objects that stand and that move."""
    slope: F64
    """(2,) of the log-likelihood along it, of the present step."""
    information: F64
    """(2,) Fisher information on it."""
    standing: F64
    """(2,) expected number of standing objects' velocities: all, and outliers."""
    moving: F64
    """(3,) of moving objects': all, missed at whatever speed, outliers."""
    outliers: F64
    """(2,) their number, and the sum of their squares along one axis."""
    gain: F64
    """(2,) slope of the log-likelihood at gain 1, and its information."""


class Residual(NamedTuple):
    """An error of a velocity and its parts."""

    error: F64
    """(2,)"""
    stated: F64
    """(2, 2) covariance that the source states, scaled."""
    track: F64
    """(2, 2) covariance of the velocity that it is compared with."""


class Before(NamedTuple):
    """What was known of the source before a step."""

    failures: Failures
    gain: float
    """Share of the speed that it reads."""
    weight: float
    """Of what the source states, in velocities."""
    kept: float
    """Share of the evidence that has not faded since the last step."""


class Known(NamedTuple):
    """What positions alone tell of N tracks."""

    mean: F64
    """(N, 11)"""
    planar: F64
    """(N, 4, 4)"""
    p_standing: F64
    """(N,)"""


@compiled
def judge(
    evidence: Evidence,
    chosen: I64,
    seen: Observation,
    tracks: Known,
    before: Before,
) -> None:
    """Add the velocities (n,) of the tracks `chosen` (n,) to the sums.

    Args:
        evidence: is changed.
        chosen: rows of the tracks.
        seen: velocities and covariances, as the present law has scaled them.
        tracks: what positions tell of all tracks.
        before: what was known before this step.
    """
    failures, gain = before.failures, before.gain
    _fade(evidence, before.kept)
    # written over for each velocity: an array of its own would cost more than what is done with it
    error, biased = np.empty(2), np.empty(2)
    nowhere, at_zero, about = np.zeros((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    for i in range(len(chosen)):
        n, v, r = chosen[i], seen.value[i], seen.covariance[i]
        d, p, q = tracks.mean[n, 7:9], tracks.planar[n, 2:, 2:], tracks.p_standing[n]
        for k in range(2):
            error[k], biased[k] = v[k] - d[k], gain * v[k] - d[k]
            for c in range(2):
                at_zero[k, c], about[k, c] = failures.rest_scale * r[k, c], p[k, c] + r[k, c]
        missed = missed_share(failures, d, p)
        zero = normal_density(v[0], v[1], at_zero)
        wild = isotropic_density(v, failures.outlier_variance, r)
        at_rest = q * (1.0 - failures.p_outlier_standing) * zero
        wild_at_rest = q * failures.p_outlier_standing * wild
        expected = normal_density(error[0], error[1], about)
        seen_moving = (1.0 - q) * (1.0 - missed - failures.p_outlier) * expected
        lost = (1.0 - q) * missed * zero
        wild_moving = (1.0 - q) * failures.p_outlier * wild
        total = at_rest + wild_at_rest + seen_moving + lost + wild_moving
        if total <= SMALLEST:
            continue
        evidence.standing[0] += (at_rest + wild_at_rest) / total
        evidence.standing[1] += wild_at_rest / total
        evidence.moving[0] += (seen_moving + lost + wild_moving) / total
        evidence.moving[1] += lost / total * failures.p_missed / max(missed, SMALLEST)
        evidence.moving[2] += wild_moving / total
        outlier = (wild_at_rest + wild_moving) / total
        evidence.outliers[0] += outlier
        evidence.outliers[1] += outlier * 0.5 * (v[0] ** 2 + v[1] ** 2)
        _learn_scale(evidence, 0, at_rest / total, Residual(v, at_zero, nowhere))
        _learn_scale(evidence, 1, seen_moving / total, Residual(error, r, p))
        for k in range(2):
            for c in range(2):
                about[k, c] = gain**2 * about[k, c] + GAIN_SPREAD**2 * d[k] * d[c]
        _learn_gain(evidence.gain, seen_moving / total, biased, (d, about))
    _step(evidence, before.weight)


@compiled
def _fade(evidence: Evidence, kept: float) -> None:
    for sums in evidence[2:]:
        for k in range(len(sums)):
            sums[k] *= kept


@compiled
def _step(evidence: Evidence, weight: float) -> None:
    """Move the log scales along their slopes, and clear these."""
    for k in range(2):
        step = evidence.slope[k] / (weight + evidence.information[k])
        evidence.log_scale[k] = max(evidence.log_scale[k] + step, 0.0)
        evidence.slope[k] = 0.0


@compiled
def _learn_gain(sums: F64, weight: float, error: F64, expected: tuple[F64, F64]) -> None:
    """Add d' S^-1 (v - d) and d' S^-1 d, with S the covariance (2, 2) of v about d."""
    d, s = expected
    xx, yy, xy = s[0, 0], s[1, 1], s[0, 1]
    determinant = xx * yy - xy * xy
    a, b = (yy * d[0] - xy * d[1]) / determinant, (xx * d[1] - xy * d[0]) / determinant
    sums[0] += weight * (a * error[0] + b * error[1])
    sums[1] += weight * (a * d[0] + b * d[1])


@compiled
def _learn_scale(evidence: Evidence, k: int, weight: float, seen: Residual) -> None:
    """Add slope and Fisher information of the log scale of what is stated, along its axes."""
    error, r, p = seen
    half, middle = 0.5 * (r[0, 0] - r[1, 1]), 0.5 * (r[0, 0] + r[1, 1])
    apart = np.hypot(half, r[0, 1])
    angle = 0.5 * np.arctan2(r[0, 1], half)
    cos, sin = np.cos(angle), np.sin(angle)
    for axis in range(2):
        own = middle + apart if axis == 0 else middle - apart
        x, y = (cos, sin) if axis == 0 else (-sin, cos)
        if own > WIDEST:
            continue
        whole = own + x * x * p[0, 0] + 2.0 * x * y * p[0, 1] + y * y * p[1, 1]
        share, along = own / whole, x * error[0] + y * error[1]
        evidence.slope[k] += weight * 0.5 * share * (along * along / whole - 1.0)
        evidence.information[k] += weight * 0.5 * share * share
