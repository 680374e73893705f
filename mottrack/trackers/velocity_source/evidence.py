"""What the velocities of tracks tell of their source, summed while the tracks are followed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64
from mottrack.geometry.two_by_two import (
    Symmetric,
    block_of,
    row_times_inverse,
    scaled,
    sum_of,
)
from mottrack.trackers.velocity_source.failures import (
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
MOST_LOG_SCALE = 20.0
"""Errors 22,000 times as large as stated: beyond it a velocity can't count for less."""

# where the sums lie in one array, since each array that is handed to a kernel costs time
LOG_SCALE = 0
"""Two, of R: of objects that stand and that move."""
SLOPE = 2
"""Two, of the log-likelihood along them, of the present step."""
INFORMATION = 4
"""Two, Fisher information on them. From here on all fades."""
STANDING = 6
"""Expected number of standing objects' velocities: all, and outliers."""
MOVING = 8
"""The same of moving objects': all, missed at whatever speed, outliers."""
OUTLIERS = 11
"""Number of outliers, and the sum of their squares along one axis."""
GAIN = 13
"""Slope of the log-likelihood at gain 1, and its information."""
KEPT = 15
"""Share of the evidence that has not faded since velocities were judged last."""
SIZE = 16
"""Length of the array."""


def no_evidence() -> F64:
    """Return the sums (SIZE,) before any velocity."""
    evidence = np.zeros(SIZE)
    evidence[KEPT] = 1.0
    return evidence


class Believed(NamedTuple):
    """What was known of the source before a step."""

    failures: Failures
    gain: float
    """Share of the speed that it reads."""
    weight: float
    """Of what the source states, in velocities."""
    memory_s: float
    """Time in which evidence fades to 1 / e."""


class Known(NamedTuple):
    """A velocity as positions alone tell it."""

    x: float
    y: float
    spread: Symmetric
    """Its covariance, if the object moves."""
    p_standing: float


class _Axes(NamedTuple):
    """Of a covariance."""

    cos: float
    sin: float
    """Of the direction of the longer one."""
    longer: float
    shorter: float
    """Variances."""


class _Error(NamedTuple):
    """Of a velocity, about one whose covariance is `spread`."""

    x: float
    y: float
    spread: Symmetric


@compiled
def believed(numbers: F64) -> Believed:
    """Return numbers (10,), the fields of `Failures` and those after them, by name."""
    failures = Failures(
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6]
    )
    return Believed(failures, numbers[7], numbers[8], numbers[9])


@compiled
def judge(evidence: F64, v: tuple[float, float], r: Symmetric, track: Known, law: Believed) -> None:
    """Add one velocity to the sums.

    Args:
        evidence: (SIZE,) is changed.
        v: the velocity.
        r: its covariance, as the present law has scaled it.
        track: what positions tell of the object.
        law: how the source errs, as it was known before this step.
    """
    failures, q, (x, y) = law.failures, track.p_standing, v
    off_x, off_y = x - track.x, y - track.y
    about = sum_of(track.spread, r)
    missed = missed_share(failures, track.x, track.y, track.spread)
    zero = normal_density(x, y, scaled(r, failures.rest_scale))
    wild = isotropic_density(x, y, failures.outlier_variance, r)
    at_rest = q * (1.0 - failures.p_outlier_standing) * zero
    wild_at_rest = q * failures.p_outlier_standing * wild
    expected = normal_density(off_x, off_y, about)
    seen_moving = (1.0 - q) * (1.0 - missed - failures.p_outlier) * expected
    lost = (1.0 - q) * missed * zero
    wild_moving = (1.0 - q) * failures.p_outlier * wild
    total = at_rest + wild_at_rest + seen_moving + lost + wild_moving
    if total <= SMALLEST:
        return
    evidence[STANDING] += (at_rest + wild_at_rest) / total
    evidence[STANDING + 1] += wild_at_rest / total
    evidence[MOVING] += (seen_moving + lost + wild_moving) / total
    evidence[MOVING + 1] += lost / total * failures.p_missed / max(missed, SMALLEST)
    evidence[MOVING + 2] += wild_moving / total
    outlier = (wild_at_rest + wild_moving) / total
    evidence[OUTLIERS] += outlier
    evidence[OUTLIERS + 1] += outlier * 0.5 * (x**2 + y**2)
    axes = _axes_of(r)
    nowhere = Symmetric(0.0, 0.0, 0.0)
    _learn_scale(evidence, 0, at_rest / total, axes, (_Error(x, y, nowhere), failures.rest_scale))
    _learn_scale(evidence, 1, seen_moving / total, axes, (_Error(off_x, off_y, track.spread), 1.0))
    _learn_gain(evidence, seen_moving / total, v, (track, about, law.gain))


@compiled
def elapse(evidence: F64, elapsed_s: float, law: Believed) -> None:
    """Let a time pass, in which the evidence (SIZE,) fades."""
    evidence[KEPT] *= np.exp(-elapsed_s / law.memory_s)


@compiled
def fade(evidence: F64) -> None:
    """Let the evidence (SIZE,) fade for the time that has passed: velocities come."""
    for k in range(INFORMATION, KEPT):
        evidence[k] *= evidence[KEPT]
    evidence[KEPT] = 1.0


@compiled
def settle(evidence: F64, law: Believed) -> None:
    """Move the log scales along their slopes, and clear these."""
    for k in range(2):
        step = evidence[SLOPE + k] / (law.weight + evidence[INFORMATION + k])
        moved = max(evidence[LOG_SCALE + k] + step, 0.0)
        evidence[LOG_SCALE + k] = min(moved, MOST_LOG_SCALE)
        evidence[SLOPE + k] = 0.0


@compiled
def judge_all(
    evidence: F64, seen: tuple[F64, F64], tracks: tuple[F64, F64, F64], law: F64, elapsed_s: float
) -> None:
    """Let a time pass and judge the velocities of n tracks, if there are any.

    Args:
        evidence: (SIZE,) is changed.
        seen: velocities (n, 2) and their covariances (n, 2, 2).
        tracks: velocities (n, 2) that positions tell, their covariances (n, 2, 2) and the
            probabilities (n,) of standing.
        law: (10,) see `believed`.
        elapsed_s: since the last step.
    """
    velocity, covariance = seen
    mean, spread, p_standing = tracks
    known_law = believed(law)
    elapse(evidence, elapsed_s, known_law)
    if len(velocity) == 0:
        return
    fade(evidence)
    for i in range(len(velocity)):
        known = Known(mean[i, 0], mean[i, 1], block_of(spread, i, 0), p_standing[i])
        v = velocity[i, 0], velocity[i, 1]
        judge(evidence, v, block_of(covariance, i, 0), known, known_law)
    settle(evidence, known_law)


@compiled
def _axes_of(r: Symmetric) -> _Axes:
    half, middle = 0.5 * (r.xx - r.yy), 0.5 * (r.xx + r.yy)
    apart = np.sqrt(half * half + r.xy * r.xy)
    # cos and sin of half the angle whose cosine is half / apart
    twice = half / apart if apart > 0.0 else 1.0
    cos = np.sqrt(max(0.5 + 0.5 * twice, 0.0))
    sin = np.copysign(np.sqrt(max(0.5 - 0.5 * twice, 0.0)), r.xy)
    return _Axes(cos, sin, middle + apart, middle - apart)


@compiled
def _learn_gain(
    evidence: F64,
    weight: float,
    v: tuple[float, float],
    expected: tuple[Known, Symmetric, float],
) -> None:
    """Add d' S^-1 (v - d) and d' S^-1 d; `expected` are d, the covariance of v, and the gain."""
    track, about, gain = expected
    d_x, d_y = track.x, track.y
    own = scaled(Symmetric(d_x * d_x, d_x * d_y, d_y * d_y), GAIN_SPREAD**2)
    a, b = row_times_inverse(d_x, d_y, sum_of(scaled(about, gain**2), own))
    evidence[GAIN] += weight * (a * (gain * v[0] - d_x) + b * (gain * v[1] - d_y))
    evidence[GAIN + 1] += weight * (a * d_x + b * d_y)


@compiled
def _learn_scale(
    evidence: F64, k: int, weight: float, axes: _Axes, seen: tuple[_Error, float]
) -> None:
    """Add slope and Fisher information of a log scale, along the axes of what is stated.

    `seen` are the error and the factor on the stated variances.
    """
    error, factor = seen
    p = error.spread
    for axis in range(2):
        own = factor * (axes.longer if axis == 0 else axes.shorter)
        x, y = (axes.cos, axes.sin) if axis == 0 else (-axes.sin, axes.cos)
        if own > WIDEST:
            continue
        whole = own + x * x * p.xx + 2.0 * x * y * p.xy + y * y * p.yy
        share, along = own / whole, x * error.x + y * error.y
        evidence[SLOPE + k] += weight * 0.5 * share * (along * along / whole - 1.0)
        evidence[INFORMATION + k] += weight * 0.5 * share * share
