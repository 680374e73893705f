"""What the velocities of tracks tell of their source, summed while the tracks are followed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.geometry.two_by_two import (
    Symmetric,
    block_of,
    row_times_inverse,
    scaled,
    sum_of,
)
from mottrack.trackers.kalman.observations import Observation
from mottrack.trackers.kalman.standing import (
    SMALLEST,
    Failures,
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

    x: float
    y: float
    stated: Symmetric
    """Covariance that the source states, scaled."""
    track: Symmetric
    """Covariance of the velocity that it is compared with."""


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
    nowhere = Symmetric(0.0, 0.0, 0.0)
    for i in range(len(chosen)):
        n, r = chosen[i], block_of(seen.covariance, i, 0)
        x, y, d_x, d_y = seen.value[i, 0], seen.value[i, 1], tracks.mean[n, 7], tracks.mean[n, 8]
        p, q = block_of(tracks.planar, n, 2), tracks.p_standing[n]
        at_zero, about = scaled(r, failures.rest_scale), sum_of(p, r)
        missed = missed_share(failures, d_x, d_y, p)
        zero = normal_density(x, y, at_zero)
        wild = isotropic_density(x, y, failures.outlier_variance, r)
        at_rest = q * (1.0 - failures.p_outlier_standing) * zero
        wild_at_rest = q * failures.p_outlier_standing * wild
        expected = normal_density(x - d_x, y - d_y, about)
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
        evidence.outliers[1] += outlier * 0.5 * (x**2 + y**2)
        _learn_scale(evidence, 0, at_rest / total, Residual(x, y, at_zero, nowhere))
        _learn_scale(evidence, 1, seen_moving / total, Residual(x - d_x, y - d_y, r, p))
        spread = scaled(Symmetric(d_x * d_x, d_x * d_y, d_y * d_y), GAIN_SPREAD**2)
        about = sum_of(scaled(about, gain**2), spread)
        biased = (gain * x - d_x, gain * y - d_y)
        _learn_gain(evidence.gain, seen_moving / total, biased, (d_x, d_y), about)
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
def _learn_gain(
    sums: F64, weight: float, error: tuple[float, float], d: tuple[float, float], s: Symmetric
) -> None:
    """Add d' S^-1 (v - d) and d' S^-1 d, with S the covariance of v about d."""
    a, b = row_times_inverse(d[0], d[1], s)
    sums[0] += weight * (a * error[0] + b * error[1])
    sums[1] += weight * (a * d[0] + b * d[1])


@compiled
def _learn_scale(evidence: Evidence, k: int, weight: float, seen: Residual) -> None:
    """Add slope and Fisher information of the log scale of what is stated, along its axes."""
    r, p = seen.stated, seen.track
    half, middle = 0.5 * (r.xx - r.yy), 0.5 * (r.xx + r.yy)
    apart = np.hypot(half, r.xy)
    angle = 0.5 * np.arctan2(r.xy, half)
    cos, sin = np.cos(angle), np.sin(angle)
    for axis in range(2):
        own = middle + apart if axis == 0 else middle - apart
        x, y = (cos, sin) if axis == 0 else (-sin, cos)
        if own > WIDEST:
            continue
        whole = own + x * x * p.xx + 2.0 * x * y * p.xy + y * y * p.yy
        share, along = own / whole, x * seen.x + y * seen.y
        evidence.slope[k] += weight * 0.5 * share * (along * along / whole - 1.0)
        evidence.information[k] += weight * 0.5 * share * share
