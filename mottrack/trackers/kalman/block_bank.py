"""All tracks as one closed-form filter with a block-diagonal covariance, compiled.

Constant velocity couples only (position, rate) pairs, and only full covariances of position or
velocity couple x with y. So the 11-D filter is a 4x4 block of (x, y, d_x, d_y), two 2x2 blocks of
z and yaw with their rates, and three scalars l, w, h: no inverse beyond 2x2. Where every
covariance is diagonal, the terms between x and y in the 4x4 block stay exactly zero.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.pose import wrap_angle
from mottrack.geometry.two_by_two import row_times_inverse
from mottrack.trackers.kalman.moments import Moments, mixture
from mottrack.trackers.kalman.noise import PairGrowth, pair_growth
from mottrack.trackers.kalman.state import (
    BOX_SIZE,
    SIZE,
    SMALLEST_SIZE_M,
    STATE_SIZE,
    XY_VELOCITY,
    YAW,
)


class Blocks(NamedTuple):
    """State of N tracks; the kernels write to it in place."""

    mean: F64
    """(N, 11)"""
    planar: F64
    """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
    variance: F64
    """(N, 5) of z, yaw, l, w, h."""
    cross: F64
    """(N, 2) covariance of z and yaw with their rates."""
    rate: F64
    """(N, 2) variances of these rates."""


class BlockBank:
    """N constant-velocity filters; `wiener` chooses the process noise (`pair_growth`)."""

    def __init__(self, *, wiener: bool) -> None:
        self._wiener = wiener
        shapes = ((0, STATE_SIZE), (0, 4, 4), (0, 5), (0, 2), (0, 2))
        self._blocks = Blocks(*(np.empty(shape) for shape in shapes))

    def __len__(self) -> int:
        return len(self.mean)

    @property
    def mean(self) -> F64:
        """(N, 11) states."""
        return self._blocks.mean

    @property
    def covariance(self) -> F64:
        """(N, 11, 11) covariances, laid out in full."""
        blocks = self._blocks
        full = np.zeros((len(self), STATE_SIZE, STATE_SIZE))
        full[:, :2, :2], full[:, :2, 7:9] = blocks.planar[:, :2, :2], blocks.planar[:, :2, 2:]
        full[:, 7:9, :2], full[:, 7:9, 7:9] = blocks.planar[:, 2:, :2], blocks.planar[:, 2:, 2:]
        axis, z_yaw = np.arange(2, BOX_SIZE), np.arange(2, 4)
        full[:, axis, axis] = blocks.variance
        full[:, z_yaw, z_yaw + 7] = full[:, z_yaw + 7, z_yaw] = blocks.cross
        full[:, z_yaw + 7, z_yaw + 7] = blocks.rate
        return full

    def xy_velocity_covariance(self) -> F64:
        """Return the covariances (N, 4, 4) of (x, y, d_x, d_y)."""
        return self._blocks.planar

    def z_yaw_size_variance(self) -> F64:
        """Return the variances (N, 5) of z, yaw, l, w, h."""
        return self._blocks.variance

    def append(self, mean: F64, variance: F64, velocity_covariance: F64) -> None:
        """Add n tracks: mean and variance (n, 11), velocity covariance (n, 2, 2)."""
        planar = planar_covariance(variance, velocity_covariance)
        new = (mean, planar, variance[:, 2:7], np.zeros((len(mean), 2)), variance[:, 9:11])
        joined = (np.concatenate(pair) for pair in zip(self._blocks, new, strict=True))
        self._blocks = Blocks(*joined)

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        self._blocks = Blocks(*(block[mask] for block in self._blocks))

    def predict(self, dt_s: F64, process: F64) -> None:
        """Advance by x <- F x, P <- F P F' + Q over dt_s (N,), with process noise (N, 11)."""
        growth = pair_growth(process, dt_s, self._wiener)
        _predict(self._blocks, dt_s, growth, process[:, 4:7] * dt_s[:, None])
        mean = self.mean
        mean[:, YAW] = wrap_angle(mean[:, YAW])
        np.maximum(mean[:, SIZE], SMALLEST_SIZE_M, out=mean[:, SIZE])

    def flip_heading(self, rows: I64) -> None:
        """Add pi to the headings of `rows`."""
        self.mean[rows, YAW] = wrap_angle(self.mean[rows, YAW] + np.pi)

    def update_box(
        self, rows: I64, residual: F64, xy_covariance: F64, z_yaw_size_variance: F64
    ) -> None:
        """Correct `rows` (n,) by box residuals (n, 7); see `Bank.update_box`."""
        # the kernels are compiled for contiguous arrays alone
        xy, rest = np.ascontiguousarray(residual[:, :2]), np.ascontiguousarray(residual[:, 2:])
        _correct_axes(self._blocks, rows, rest, np.ascontiguousarray(z_yaw_size_variance))
        correct_planar(self._blocks, rows, 0, xy, np.ascontiguousarray(xy_covariance))
        self.mean[rows, YAW] = wrap_angle(self.mean[rows, YAW])

    def update_yaw(self, rows: I64, residual: F64, variance: F64) -> None:
        """Correct the headings of `rows` (n,) by residuals (n,); see `Bank.update_yaw`."""
        _correct_yaw(self._blocks, rows, residual, variance)

    def update_velocity(self, rows: I64, residual: F64, covariance: F64, weight: F64) -> None:
        """Correct `rows` (n,) by velocities that are correct with `weight`; see `Bank`."""
        unsure = np.flatnonzero(weight < 1.0)
        mixed = rows[unsure]
        before = Moments(self.mean[mixed][:, XY_VELOCITY], self._blocks.planar[mixed])
        contiguous = np.ascontiguousarray(residual), np.ascontiguousarray(covariance)
        correct_planar(self._blocks, rows, 2, *contiguous)
        if len(mixed):
            after = Moments(self.mean[mixed][:, XY_VELOCITY], self._blocks.planar[mixed])
            mean, self._blocks.planar[mixed] = mixture(before, after, weight[unsure])
            self.mean[mixed[:, None], XY_VELOCITY] = mean


def planar_covariance(variance: F64, velocity_covariance: F64) -> F64:
    """Return the covariance (n, 4, 4) of (x, y, d_x, d_y) from variances (n, 11) and (n, 2, 2)."""
    planar = np.zeros((len(variance), 4, 4))
    planar[:, 0, 0], planar[:, 1, 1] = variance[:, 0], variance[:, 1]
    planar[:, 2:, 2:] = velocity_covariance
    return planar


@compiled
def _predict(blocks: Blocks, dt: F64, growth: PairGrowth, size_growth: F64) -> None:
    """Predict over dt (N,): x <- F x, P <- F P F' + Q; `size_growth` (N, 3) is that of l, w, h."""
    mean, planar, variance, cross, rate = blocks
    by_position, by_both, by_rate = growth
    for n in range(len(mean)):
        t = dt[n]
        for k in range(4):
            mean[n, k] += t * mean[n, k + 7]
        predict_planar(planar[n], t)
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
def predict_planar(p: F64, t: float) -> None:
    """Write F P F' over p (4, 4) for F = [[I, t I], [0, I]]."""
    for r in range(2):
        for c in range(4):
            p[r, c] += t * p[r + 2, c]
    for r in range(4):
        for c in range(2):
            p[r, c] += t * p[r, c + 2]


@compiled
def _correct_axes(blocks: Blocks, rows: I64, residual: F64, noise: F64) -> None:
    """Apply scalar updates to `rows` (n,): residuals and variances (n, 5) of z, yaw, l, w, h."""
    mean, variance, cross, rate = blocks.mean, blocks.variance, blocks.cross, blocks.rate
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
def _correct_yaw(blocks: Blocks, rows: I64, residual: F64, noise: F64) -> None:
    """Apply scalar updates to the headings of `rows` (n,): residuals and variances (n,)."""
    mean, variance, cross, rate = blocks.mean, blocks.variance, blocks.cross, blocks.rate
    for m in range(len(rows)):
        n = rows[m]
        total = variance[n, 1] + noise[m]
        gain, rate_gain = variance[n, 1] / total, cross[n, 1] / total
        turned = mean[n, YAW] + gain * residual[m]
        mean[n, YAW] = (turned + math.pi) % (2.0 * math.pi) - math.pi
        mean[n, YAW + 7] += rate_gain * residual[m]
        variance[n, 1] = gain * noise[m]
        rate[n, 1] -= rate_gain * cross[n, 1]
        cross[n, 1] *= 1 - gain


@compiled
def correct_planar(blocks: Blocks, rows: I64, first: int, residual: F64, noise: F64) -> None:
    """Apply Joseph updates P <- (I - K H) P (I - K H)' + K R K' to (x, y, d_x, d_y).

    Observed are its two numbers from `first` on: residuals (n, 2), covariances (n, 2, 2).
    """
    mean, planar = blocks.mean, blocks.planar
    gain, keep = np.empty((4, 2)), np.empty((4, 4))
    work = np.empty((4, 4))
    for m in range(len(rows)):
        p = planar[rows[m]]
        s = p[first : first + 2, first : first + 2] + noise[m]
        for r in range(4):
            gain[r, 0], gain[r, 1] = row_times_inverse(p[r, first : first + 2], s)
            at = r if r < 2 else r + 5
            mean[rows[m], at] += gain[r, 0] * residual[m, 0] + gain[r, 1] * residual[m, 1]
            for c in range(4):
                keep[r, c] = 1.0 if r == c else 0.0
            keep[r, first] -= gain[r, 0]
            keep[r, first + 1] -= gain[r, 1]
        _joseph(p, keep, gain, noise[m], work)


@compiled
def _joseph(p: F64, keep: F64, gain: F64, noise: F64, work: F64) -> None:
    """Write the corrected covariance over p (4, 4), exactly symmetric."""
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
