"""All tracks as one closed-form filter: constant velocity, block-diagonal covariance.

Constant velocity couples only (position, rate) pairs and the noise is diagonal, so the 11-D filter
is four 2x2 filters (x, y, z, yaw with their rates) and three scalars (l, w, h): no matrix inverse.
A full 2x2 covariance of position or velocity couples x and y; from then on (x, y, d_x, d_y) is one
4x4 block, nothing more.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.pose import wrap_angle
from mottrack.trackers.kalman.noise_model import pair_growth
from mottrack.trackers.kalman.state import (
    CV_SIZE,
    MOVING,
    PLANAR,
    RATE,
    SIZE,
    SMALLEST_SIZE_M,
    YAW,
)
from mottrack.trackers.kalman.two_by_two import inverse_2x2

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class BlockBank:
    """N constant-velocity filters; `wiener` chooses the process noise (`pair_growth`)."""

    size = CV_SIZE

    def __init__(self, *, wiener: bool) -> None:
        self._wiener = wiener
        self.mean: F64 = np.empty((0, CV_SIZE))
        self._variance: F64 = np.empty((0, 7))
        self._cross: F64 = np.empty((0, 4))
        self._rate_variance: F64 = np.empty((0, 4))
        self._planar: F64 | None = None

    def __len__(self) -> int:
        return len(self.mean)

    @property
    def covariance(self) -> F64:
        """(N, 11, 11) covariances, laid out in full."""
        full = np.zeros((len(self), CV_SIZE, CV_SIZE))
        box, moving = np.arange(7), np.arange(4)
        full[:, box, box] = self._variance
        full[:, moving, moving + 7] = full[:, moving + 7, moving] = self._cross
        full[:, moving + 7, moving + 7] = self._rate_variance
        full[:, np.array(PLANAR)[:, None], PLANAR] = self.planar_covariance()
        return full

    def planar_covariance(self) -> F64:
        """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
        if self._planar is not None:
            return self._planar
        block = np.zeros((len(self), 4, 4))
        i = np.arange(2)
        block[:, i, i] = self._variance[:, :2]
        block[:, i, i + 2] = block[:, i + 2, i] = self._cross[:, :2]
        block[:, i + 2, i + 2] = self._rate_variance[:, :2]
        return block

    def axial_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        return self._variance[:, 2:]

    def append(self, mean: F64, variance: F64, velocity_covariance: F64, model: I64) -> None:
        """Adds n tracks: mean (n, 11), variance (n, 11), velocity covariance (n, 2, 2).

        `model` is of no consequence: every track here moves at constant velocity.
        """
        new = BlockBank(wiener=self._wiener)
        new.mean, new._variance = mean, variance[:, :7]
        new._cross, new._rate_variance = np.zeros((len(mean), 4)), variance[:, 7:11]
        if self._planar is not None or _is_full(velocity_covariance):
            self._couple()
            new._couple()
            new._planar[:, 2:, 2:] = velocity_covariance  # type: ignore[index]
        else:
            new._rate_variance = new._rate_variance.copy()
            new._rate_variance[:, :2] = np.diagonal(velocity_covariance, axis1=1, axis2=2)
        for name, array in self._arrays().items():
            setattr(self, name, np.concatenate([array, getattr(new, name)]))

    def keep(self, mask: NDArray[np.bool_]) -> None:
        """Drops every track outside the mask (N,)."""
        for name, array in self._arrays().items():
            setattr(self, name, array[mask])

    def predict(self, dt_s: F64, process: F64) -> None:
        """Advances by x <- F x, P <- F P F' + Q over dt_s (N,), with process noise (N, 13)."""
        dt = dt_s[:, None]
        var, cross, rate = pair_growth(process, dt_s, self._wiener)
        self.mean[:, MOVING] += dt * self.mean[:, RATE]
        self._variance[:, :4] += 2 * dt * self._cross + dt**2 * self._rate_variance + var
        self._variance[:, 4:] += process[:, 4:7] * dt
        self._cross += dt * self._rate_variance + cross
        self._rate_variance += rate
        if self._planar is not None:
            self._planar = _advance(self._planar, dt_s)
            i = np.arange(2)
            self._planar[:, i, i] += var[:, :2]
            self._planar[:, i, i + 2] += cross[:, :2]
            self._planar[:, i + 2, i] += cross[:, :2]
            self._planar[:, i + 2, i + 2] += rate[:, :2]
        self.mean[:, YAW] = wrap_angle(self.mean[:, YAW])
        self.mean[:, SIZE] = np.maximum(self.mean[:, SIZE], SMALLEST_SIZE_M)

    def turn(self, rows: I64) -> None:
        """Turns the boxes of `rows` round by half a turn."""
        self.mean[rows, YAW] = wrap_angle(self.mean[rows, YAW] + np.pi)

    def update_box(self, rows: I64, residual: F64, position: F64, axial: F64) -> None:
        """Corrects `rows` (n,) by box residuals (n, 7).

        `position` (n, 2, 2) is the covariance of the observed x, y and `axial` (n, 5) are the
        variances of z, yaw, l, w, h.
        """
        if self._planar is None and _is_full(position):
            self._couple()
        if self._planar is None:
            noise = np.hstack([np.diagonal(position, axis1=1, axis2=2), axial])
            self._correct(rows, np.arange(7), residual, noise)
        else:
            self._correct(rows, np.arange(2, 7), residual[:, 2:], axial)
            self._correct_planar(rows, 0, residual[:, :2], position)
        self.mean[rows, YAW] = wrap_angle(self.mean[rows, YAW])

    def update_velocity(self, rows: I64, residual: F64, covariance: F64) -> None:
        """Corrects `rows` (n,) by velocity residuals (n, 2) with covariances (n, 2, 2)."""
        if self._planar is None and _is_full(covariance):
            self._couple()
        if self._planar is not None:
            self._correct_planar(rows, 2, residual, covariance)
            return
        noise = np.diagonal(covariance, axis1=1, axis2=2)
        a, b, c = self._variance[rows, :2], self._cross[rows, :2], self._rate_variance[rows, :2]
        gain = b / (c + noise)
        rate_gain = c / (c + noise)
        self.mean[rows, :2] += gain * residual
        self.mean[rows, 7:9] += rate_gain * residual
        self._variance[rows, :2] = a - gain * b
        self._cross[rows, :2] = b * (1 - rate_gain)
        self._rate_variance[rows, :2] = rate_gain * noise

    def _correct(self, rows: I64, axes: I64, residual: F64, noise: F64) -> None:
        """Scalar updates of the observed box numbers `axes`, each with its rate if it has one."""
        at = np.ix_(rows, axes)
        gain = self._variance[at] / (self._variance[at] + noise)
        moving = axes < 4
        pair = np.ix_(rows, axes[moving])
        rate_gain = self._cross[pair] / (self._variance[pair] + noise[:, moving])
        self.mean[at] += gain * residual
        self.mean[np.ix_(rows, axes[moving] + 7)] += rate_gain * residual[:, moving]
        self._rate_variance[pair] -= rate_gain * self._cross[pair]
        self._cross[pair] *= 1 - gain[:, moving]
        self._variance[at] = gain * noise

    def _correct_planar(self, rows: I64, first: int, residual: F64, noise: F64) -> None:
        """Joseph update of (x, y, d_x, d_y) by its two numbers from `first` on."""
        if self._planar is None:
            return
        prior = self._planar[rows]
        seen = slice(first, first + 2)
        gain = prior[:, :, seen] @ inverse_2x2(prior[:, seen, seen] + noise)
        keep = np.broadcast_to(np.eye(4), prior.shape).copy()
        keep[:, :, seen] -= gain
        posterior = keep @ prior @ keep.swapaxes(1, 2) + gain @ noise @ gain.swapaxes(1, 2)
        self._planar[rows] = 0.5 * (posterior + posterior.swapaxes(1, 2))
        self.mean[np.ix_(rows, np.array(PLANAR))] += (gain @ residual[:, :, None])[:, :, 0]

    def _couple(self) -> None:
        if self._planar is None:
            self._planar = self.planar_covariance()

    def _arrays(self) -> dict[str, NDArray[Any]]:
        names = ["mean", "_variance", "_cross", "_rate_variance"]
        if self._planar is not None:
            names.append("_planar")
        return {name: getattr(self, name) for name in names}


def _advance(planar: F64, dt_s: F64) -> F64:
    """F P F' for F = [[I, t I], [0, I]]."""
    moved = planar.copy()
    dt = dt_s[:, None, None]
    moved[:, :2, :] += dt * planar[:, 2:, :]
    moved[:, :, :2] += dt * moved[:, :, 2:]
    return moved


def _is_full(covariance: F64) -> bool:
    return bool((covariance[:, 0, 1] != 0.0).any())
