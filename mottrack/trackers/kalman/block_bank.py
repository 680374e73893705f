"""All tracks as one closed-form filter with a block-diagonal covariance, compiled.

Constant velocity couples only (position, rate) pairs, and only full covariances of position or
velocity couple x with y. So the 11-D filter is a 4x4 block of (x, y, d_x, d_y), two 2x2 blocks of
z and yaw with their rates, and three scalars l, w, h: no inverse beyond 2x2. Where every
covariance is diagonal, the terms between x and y in the 4x4 block stay exactly zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.pose import wrap_angle
from mottrack.geometry.angles import modulo_pi, wrapped
from mottrack.geometry.two_by_two import Symmetric, block_of, row_times_inverse, sum_of
from mottrack.trackers.kalman.observations import Matched, Observation, SeenBoxes
from mottrack.trackers.kalman.state import BOX_SIZE, SMALLEST_SIZE_M, STATE_SIZE, YAW


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


class Residual(NamedTuple):
    """Of two numbers that were observed together."""

    x: float
    y: float
    noise: Symmetric


class Growth(NamedTuple):
    """Process noise over a step of one pair (position, rate)."""

    position: float
    both: float
    """Covariance of the position with its rate."""
    rate: float


class BlockBank:
    """N constant-velocity filters; `wiener` chooses the process noise (`pair_growth`)."""

    def __init__(self, *, wiener: bool) -> None:
        self._wiener = wiener
        shapes = ((0, STATE_SIZE), (0, 4, 4), (0, 5), (0, 2), (0, 2))
        self._blocks = Blocks(*(np.empty(shape) for shape in shapes))

    def __len__(self) -> int:
        return len(self._blocks.mean)

    @property
    def filters(self) -> tuple[F64, F64]:
        """(N, 11) states, and covariances (N, 4, 4) of (x, y, d_x, d_y)."""
        return self._blocks.mean, self._blocks.planar

    @property
    def z_yaw_size_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        return self._blocks.variance

    def covariance(self, rows: I64) -> F64:
        """Return the covariances (n, 11, 11) of `rows` (n,), laid out in full."""
        return _in_full(self._blocks, rows)

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
        _predict(self._blocks, dt_s, process, self._wiener)

    def flip_heading(self, rows: I64) -> None:
        """Add pi to the headings of `rows`."""
        if len(rows):
            self._blocks.mean[rows, YAW] = wrap_angle(self._blocks.mean[rows, YAW] + np.pi)

    def update_box(self, matched: Matched, seen: SeenBoxes) -> None:
        """Correct the matched tracks by their boxes; see `Bank.update_box`."""
        _update_box(self._blocks, matched, seen)

    def update_yaw(self, rows: I64, residual: F64, variance: F64) -> None:
        """Correct the headings of `rows` (n,) by residuals (n,); see `Bank.update_yaw`."""
        _update_yaw(self._blocks, rows, residual, variance)

    def update_velocity(self, rows: I64, velocity: Observation, weight: F64) -> None:
        """Correct `rows` (n,) by velocities that are correct with `weight` (n,); see `Bank`."""
        _update_velocity(self.filters, rows, velocity, weight)


def planar_covariance(variance: F64, velocity_covariance: F64) -> F64:
    """Return the covariance (n, 4, 4) of (x, y, d_x, d_y) from variances (n, 11) and (n, 2, 2)."""
    planar = np.zeros((len(variance), 4, 4))
    planar[:, 0, 0], planar[:, 1, 1] = variance[:, 0], variance[:, 1]
    planar[:, 2:, 2:] = velocity_covariance
    return planar


@compiled
def _in_full(blocks: Blocks, rows: I64) -> F64:
    full = np.zeros((len(rows), STATE_SIZE, STATE_SIZE))
    for i in range(len(rows)):
        n = rows[i]
        for r in range(4):
            for c in range(4):
                full[i, r if r < 2 else r + 5, c if c < 2 else c + 5] = blocks.planar[n, r, c]
        for k in range(5):
            full[i, k + 2, k + 2] = blocks.variance[n, k]
        for k in range(2):
            full[i, k + 2, k + 9] = full[i, k + 9, k + 2] = blocks.cross[n, k]
            full[i, k + 9, k + 9] = blocks.rate[n, k]
    return full


@compiled
def _growth(p: float, q: float, t: float, wiener: bool) -> Growth:
    """Return what `noise.pair_growth` does, of one pair."""
    if wiener:
        return Growth(p * t + q * t**3 / 3.0, q * t**2 / 2.0, q * t)
    return Growth(p * t, 0.0, q * t)


@compiled
def _predict(blocks: Blocks, dt: F64, process: F64, wiener: bool) -> None:
    mean, planar, variance, cross, rate = blocks
    for n in range(len(mean)):
        t = dt[n]
        predict_planar((mean, planar), n, process, t, wiener)
        for k in range(2):
            growth = _growth(process[n, k + 2], process[n, k + 9], t, wiener)
            mean[n, k + 2] += t * mean[n, k + 9]
            variance[n, k] += 2 * t * cross[n, k] + t * t * rate[n, k] + growth.position
            cross[n, k] += t * rate[n, k] + growth.both
            rate[n, k] += growth.rate
        mean[n, YAW] = wrapped(mean[n, YAW])
        for k in range(4, BOX_SIZE):
            variance[n, k - 2] += process[n, k] * t
            mean[n, k] = max(mean[n, k], SMALLEST_SIZE_M)


@compiled
def predict_planar(filters: tuple[F64, F64], n: int, process: F64, t: float, wiener: bool) -> None:
    """Advance (x, y, d_x, d_y) of track `n` by F = [[I, t I], [0, I]] and `process` (N, 11)."""
    mean, p = filters
    for r in range(2):
        mean[n, r] += t * mean[n, r + 7]
        for c in range(4):
            p[n, r, c] += t * p[n, r + 2, c]
    for r in range(4):
        for c in range(2):
            p[n, r, c] += t * p[n, r, c + 2]
    for k in range(2):
        growth = _growth(process[n, k], process[n, k + 7], t, wiener)
        p[n, k, k] += growth.position
        p[n, k, k + 2] += growth.both
        p[n, k + 2, k] += growth.both
        p[n, k + 2, k + 2] += growth.rate


@compiled
def _update_box(blocks: Blocks, matched: Matched, seen: SeenBoxes) -> None:
    mean, planar, variance, cross, rate = blocks
    work = np.empty((4, 8))
    for m in range(len(matched.rows)):
        n, i = matched.rows[m], matched.columns[m]
        for k in range(5):
            noise, residual = seen.z_yaw_size_variance[i, k], seen.box[i, k + 2] - mean[n, k + 2]
            if k + 2 == YAW:
                residual = modulo_pi(residual)
            total = variance[n, k] + noise
            gain = variance[n, k] / total
            mean[n, k + 2] += gain * residual
            variance[n, k] = gain * noise
            if k < 2:
                rate_gain = cross[n, k] / total
                mean[n, k + 9] += rate_gain * residual
                rate[n, k] -= rate_gain * cross[n, k]
                cross[n, k] *= 1 - gain
        mean[n, YAW] = wrapped(mean[n, YAW])
        x, y = seen.box[i, 0] - mean[n, 0], seen.box[i, 1] - mean[n, 1]
        centre = Residual(x, y, block_of(seen.xy_covariance, i, 0))
        correct_planar((mean, planar), n, 0, centre, work)


@compiled
def _update_yaw(blocks: Blocks, rows: I64, residual: F64, noise: F64) -> None:
    """Apply scalar updates to the headings of `rows` (n,): residuals and variances (n,)."""
    mean, variance, cross, rate = blocks.mean, blocks.variance, blocks.cross, blocks.rate
    for m in range(len(rows)):
        n = rows[m]
        total = variance[n, 1] + noise[m]
        gain, rate_gain = variance[n, 1] / total, cross[n, 1] / total
        mean[n, YAW] = wrapped(mean[n, YAW] + gain * residual[m])
        mean[n, YAW + 7] += rate_gain * residual[m]
        variance[n, 1] = gain * noise[m]
        rate[n, 1] -= rate_gain * cross[n, 1]
        cross[n, 1] *= 1 - gain


@compiled
def _update_velocity(
    filters: tuple[F64, F64], rows: I64, velocity: Observation, weight: F64
) -> None:
    mean, planar = filters
    work, covariance = np.empty((4, 8)), np.empty((4, 4))
    before, apart = np.empty(4), np.empty(4)
    for m in range(len(rows)):
        n, w = rows[m], weight[m]
        for r in range(4):
            before[r] = mean[n, r if r < 2 else r + 5]
            for c in range(4):
                covariance[r, c] = planar[n, r, c]
        x, y = velocity.value[m, 0] - mean[n, 7], velocity.value[m, 1] - mean[n, 8]
        residual = Residual(x, y, block_of(velocity.covariance, m, 0))
        correct_planar(filters, n, 2, residual, work)
        if w >= 1.0:
            continue
        # the Gaussian of the same moments as the mixture of both states (`moments.mixture`)
        for r in range(4):
            at = r if r < 2 else r + 5
            apart[r] = mean[n, at] - before[r]
            mean[n, at] = before[r] + w * apart[r]
        for r in range(4):
            for c in range(4):
                change = planar[n, r, c] - covariance[r, c] + (1.0 - w) * apart[r] * apart[c]
                planar[n, r, c] = covariance[r, c] + w * change


@compiled
def correct_planar(filters: tuple[F64, F64], n: int, first: int, seen: Residual, work: F64) -> None:
    """Apply the Joseph update P <- (I - K H) P (I - K H)' + K R K' to (x, y, d_x, d_y) of track n.

    Observed are its two numbers from `first` on. The covariance stays exactly symmetric. `work`
    (4, 8) is written over.
    """
    mean, p = filters
    second, noise = first + 1, seen.noise
    s = sum_of(block_of(p, n, first), noise)
    for r in range(4):
        gain_x, gain_y = row_times_inverse(p[n, r, first], p[n, r, second], s)
        mean[n, r if r < 2 else r + 5] += gain_x * seen.x + gain_y * seen.y
        observed = first <= r <= second
        keep_x, keep_y = int(r == first) - gain_x, int(r == second) - gain_y
        work[r, 4], work[r, 5], work[r, 6], work[r, 7] = gain_x, gain_y, keep_x, keep_y
        for c in range(4):
            rest = 0.0 if observed else p[n, r, c]
            work[r, c] = rest + keep_x * p[n, first, c] + keep_y * p[n, second, c]
    for r in range(4):
        left = work[r, 4] * noise.xx + work[r, 5] * noise.xy
        right = work[r, 4] * noise.xy + work[r, 5] * noise.yy
        for c in range(r + 1):
            total = 0.0 if first <= c <= second else work[r, c]
            total += work[r, first] * work[c, 6] + work[r, second] * work[c, 7]
            p[n, r, c] = p[n, c, r] = total + left * work[c, 4] + right * work[c, 5]
