"""The filters of `BlockBank` in place, track by track, compiled.

A track is a row of `mean` (N, 11), `planar` (N, 4, 4) of (x, y, d_x, d_y), `variance` (N, 5) of
z, yaw, l, w, h, and for z and yaw `cross` (N, 2) with their rates and `rate` (N, 2) of these.
"""

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64

Blocks = tuple[F64, F64, F64, F64, F64]
"""mean, planar, variance, cross, rate."""


@compiled
def advance(blocks: Blocks, dt: F64, growth: tuple[F64, F64, F64], size_growth: F64) -> None:
    """Predicts over dt (N,): x <- F x, P <- F P F' + Q.

    Q is given by `pair_growth`, three arrays (N, 4), and the growth of l, w, h (N, 3).
    """
    mean, planar, variance, cross, rate = blocks
    by_position, by_both, by_rate = growth
    for n in range(len(mean)):
        t = dt[n]
        for k in range(4):
            mean[n, k] += t * mean[n, k + 7]
        _advance_planar(planar[n], t)
        for k in range(2):
            planar[n, k, k] += by_position[n, k]
            planar[n, k, k + 2] += by_both[n, k]
            planar[n, k + 2, k] += by_both[n, k]
            planar[n, k + 2, k + 2] += by_rate[n, k]
            variance[n, k] += 2 * t * cross[n, k] + t * t * rate[n, k] + by_position[n, k + 2]
            cross[n, k] += t * rate[n, k] + by_both[n, k + 2]
            rate[n, k] += by_rate[n, k + 2]
        for k in range(3):
            variance[n, k + 2] += size_growth[n, k]


@compiled
def _advance_planar(p: F64, t: float) -> None:
    """F P F' for F = [[I, t I], [0, I]]."""
    for r in range(2):
        for c in range(4):
            p[r, c] += t * p[r + 2, c]
    for r in range(4):
        for c in range(2):
            p[r, c] += t * p[r, c + 2]


@compiled
def correct_axes(blocks: Blocks, rows: I64, residual: F64, noise: F64) -> None:
    """Scalar updates of `rows` (n,) by residuals (n, 5) of z, yaw, l, w, h with variances."""
    mean, _, variance, cross, rate = blocks
    for m in range(len(rows)):
        n = rows[m]
        for k in range(5):
            total = variance[n, k] + noise[m, k]
            gain = variance[n, k] / total
            mean[n, k + 2] += gain * residual[m, k]
            variance[n, k] = gain * noise[m, k]
            if k < 2:
                rate_gain = cross[n, k] / total
                mean[n, k + 9] += rate_gain * residual[m, k]
                rate[n, k] -= rate_gain * cross[n, k]
                cross[n, k] *= 1 - gain


@compiled
def correct_planar(blocks: Blocks, rows: I64, first: int, residual: F64, noise: F64) -> None:
    """Joseph update P <- (I - K H) P (I - K H)' + K R K' of (x, y, d_x, d_y).

    Observed are its two numbers from `first` on: residuals (n, 2), covariances (n, 2, 2).
    """
    mean, planar = blocks[0], blocks[1]
    gain, keep = np.empty((4, 2)), np.empty((4, 4))
    work = np.empty((4, 4))
    for m in range(len(rows)):
        p = planar[rows[m]]
        _gain(p, first, noise[m], gain)
        for r in range(4):
            at = r if r < 2 else r + 5
            mean[rows[m], at] += gain[r, 0] * residual[m, 0] + gain[r, 1] * residual[m, 1]
            for c in range(4):
                keep[r, c] = 1.0 if r == c else 0.0
            keep[r, first] -= gain[r, 0]
            keep[r, first + 1] -= gain[r, 1]
        _joseph(p, keep, gain, noise[m], work)


@compiled
def _gain(p: F64, first: int, noise: F64, gain: F64) -> None:
    """K = P H' (H P H' + R)^-1, (4, 2)."""
    a = p[first, first] + noise[0, 0]
    b = p[first, first + 1] + noise[0, 1]
    d = p[first + 1, first + 1] + noise[1, 1]
    determinant = a * d - b * b
    for r in range(4):
        x, y = p[r, first], p[r, first + 1]
        gain[r, 0] = (x * d - y * b) / determinant
        gain[r, 1] = (y * a - x * b) / determinant


@compiled
def _joseph(p: F64, keep: F64, gain: F64, noise: F64, work: F64) -> None:
    """Writes the corrected covariance over p (4, 4), exactly symmetric."""
    for r in range(4):
        for c in range(4):
            total = 0.0
            for k in range(4):
                total += keep[r, k] * p[k, c]
            work[r, c] = total
    for r in range(4):
        left = gain[r, 0] * noise[0, 0] + gain[r, 1] * noise[1, 0]
        right = gain[r, 0] * noise[0, 1] + gain[r, 1] * noise[1, 1]
        for c in range(r + 1):
            total = left * gain[c, 0] + right * gain[c, 1]
            for k in range(4):
                total += work[r, k] * keep[c, k]
            p[r, c] = p[c, r] = total
