"""All tracks as one closed-form filter: constant velocity, block-diagonal covariance.

Constant velocity couples only (position, rate) pairs, and only full covariances of position or
velocity couple x with y. So the 11-D filter is a 4x4 block of (x, y, d_x, d_y), two 2x2 blocks of
z and yaw with their rates, and three scalars l, w, h: no inverse beyond 2x2. Where every
covariance is diagonal, what lies between x and y in the 4x4 block stays exactly zero.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.pose import wrap_angle
from mottrack.trackers.kalman.block_kernels import Blocks, advance, correct_axes, correct_planar
from mottrack.trackers.kalman.noise_model import pair_growth
from mottrack.trackers.kalman.state import BOX_SIZE, CV_SIZE, SIZE, SMALLEST_SIZE_M, YAW


class BlockBank:
    """N constant-velocity filters; `wiener` chooses the process noise (`pair_growth`)."""

    size = CV_SIZE

    def __init__(self, *, wiener: bool) -> None:
        self._wiener = wiener
        self._blocks: Blocks = (
            np.empty((0, CV_SIZE)),
            np.empty((0, 4, 4)),
            np.empty((0, 5)),
            np.empty((0, 2)),
            np.empty((0, 2)),
        )

    def __len__(self) -> int:
        return len(self.mean)

    @property
    def mean(self) -> F64:
        """(N, 11) states."""
        return self._blocks[0]

    @property
    def covariance(self) -> F64:
        """(N, 11, 11) covariances, laid out in full."""
        _, planar, variance, cross, rate = self._blocks
        full = np.zeros((len(self), CV_SIZE, CV_SIZE))
        full[:, :2, :2], full[:, :2, 7:9] = planar[:, :2, :2], planar[:, :2, 2:]
        full[:, 7:9, :2], full[:, 7:9, 7:9] = planar[:, 2:, :2], planar[:, 2:, 2:]
        axis, turning = np.arange(2, BOX_SIZE), np.arange(2, 4)
        full[:, axis, axis] = variance
        full[:, turning, turning + 7] = full[:, turning + 7, turning] = cross
        full[:, turning + 7, turning + 7] = rate
        return full

    def planar_covariance(self) -> F64:
        """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
        return self._blocks[1]

    def axial_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        return self._blocks[2]

    def append(self, mean: F64, variance: F64, velocity_covariance: F64, model: I64) -> None:
        """Adds n tracks: mean (n, 11), variance (n, 11), velocity covariance (n, 2, 2).

        `model` is of no consequence: every track here moves at constant velocity.
        """
        planar = np.zeros((len(mean), 4, 4))
        planar[:, 0, 0], planar[:, 1, 1] = variance[:, 0], variance[:, 1]
        planar[:, 2:, 2:] = velocity_covariance
        new = (mean, planar, variance[:, 2:7], np.zeros((len(mean), 2)), variance[:, 9:11])
        joined = [np.concatenate(pair) for pair in zip(self._blocks, new, strict=True)]
        self._blocks = tuple(joined)  # type: ignore[assignment]

    def keep(self, mask: Mask) -> None:
        """Drops every track outside the mask (N,)."""
        self._blocks = tuple(block[mask] for block in self._blocks)  # type: ignore[assignment]

    def predict(self, dt_s: F64, process: F64) -> None:
        """Advances by x <- F x, P <- F P F' + Q over dt_s (N,), with process noise (N, 13)."""
        growth = pair_growth(process, dt_s, self._wiener)
        advance(self._blocks, dt_s, growth, process[:, 4:7] * dt_s[:, None])
        mean = self.mean
        mean[:, YAW] = wrap_angle(mean[:, YAW])
        np.maximum(mean[:, SIZE], SMALLEST_SIZE_M, out=mean[:, SIZE])

    def turn(self, rows: I64) -> None:
        """Turns the boxes of `rows` round by half a turn."""
        self.mean[rows, YAW] = wrap_angle(self.mean[rows, YAW] + np.pi)

    def update_box(self, rows: I64, residual: F64, position: F64, axial: F64) -> None:
        """Corrects `rows` (n,) by box residuals (n, 7).

        `position` (n, 2, 2) is the covariance of the observed x, y and `axial` (n, 5) are the
        variances of z, yaw, l, w, h.
        """
        plane, rest = _plain(residual[:, :2]), _plain(residual[:, 2:])
        correct_axes(self._blocks, rows, rest, _plain(axial))
        correct_planar(self._blocks, rows, 0, plane, _plain(position))
        self.mean[rows, YAW] = wrap_angle(self.mean[rows, YAW])

    def update_velocity(self, rows: I64, residual: F64, covariance: F64) -> None:
        """Corrects `rows` (n,) by velocity residuals (n, 2) with covariances (n, 2, 2)."""
        correct_planar(self._blocks, rows, 2, _plain(residual), _plain(covariance))


def _plain(array: F64) -> F64:
    """In one piece of memory: the kernels are compiled for that alone."""
    return np.ascontiguousarray(array)
