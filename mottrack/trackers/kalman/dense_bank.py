"""All tracks as a stack of dense filters (N, D, D): any motion model, Joseph form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.pose import wrap_angle
from mottrack.trackers.kalman.motion_models import MOTION_MODELS
from mottrack.trackers.kalman.noise_model import process_covariance
from mottrack.trackers.kalman.state import (
    BOX_SIZE,
    CA_SIZE,
    CV_SIZE,
    PLANAR,
    SIZE,
    SMALLEST_SIZE_M,
    VELOCITY,
    YAW,
)


class DenseBank:
    """N extended Kalman filters; each track moves by one of the named `models`."""

    def __init__(self, models: Sequence[str], *, wiener: bool) -> None:
        self._models = tuple(models)
        self._wiener = wiener
        self.size = CA_SIZE if "ca" in models else CV_SIZE
        self.mean: F64 = np.empty((0, self.size))
        self.covariance: F64 = np.empty((0, self.size, self.size))
        self._model: I64 = np.empty(0, np.int64)

    def __len__(self) -> int:
        return len(self.mean)

    def resize(self, size: int) -> None:
        """Gives an empty bank states of `size` numbers, so that several banks mix."""
        self.size = size
        self.mean, self.covariance = np.empty((0, size)), np.empty((0, size, size))

    def planar_covariance(self) -> F64:
        """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
        return self.covariance[:, np.array(PLANAR)[:, None], PLANAR]

    def axial_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        return np.diagonal(self.covariance, axis1=1, axis2=2)[:, 2:7]

    def append(self, mean: F64, variance: F64, velocity_covariance: F64, model: I64) -> None:
        """Adds n tracks: mean and variance (n, D), velocity covariance (n, 2, 2), model (n,)."""
        covariance = variance[:, :, None] * np.eye(self.size)
        covariance[:, VELOCITY, VELOCITY] = velocity_covariance
        self.mean = np.concatenate([self.mean, mean])
        self.covariance = np.concatenate([self.covariance, covariance])
        self._model = np.append(self._model, model)

    def keep(self, mask: Mask) -> None:
        """Drops every track outside the mask (N,)."""
        self.mean, self.covariance = self.mean[mask], self.covariance[mask]
        self._model = self._model[mask]

    def predict(self, dt_s: F64, process: F64) -> None:
        """Advances by x <- f(x), P <- F P F' + Q over dt_s (N,), process noise (N, 13)."""
        for k, name in enumerate(self._models):
            rows = np.flatnonzero((self._model == k) & (dt_s > 0))
            if len(rows) == 0:
                continue
            self.mean[rows], jacobian = MOTION_MODELS[name](self.mean[rows], dt_s[rows])
            noise = process_covariance(process[rows], dt_s[rows], name, self.size, self._wiener)
            spread = jacobian @ self.covariance[rows] @ jacobian.swapaxes(1, 2) + noise
            self.covariance[rows] = 0.5 * (spread + spread.swapaxes(1, 2))
        self.mean[:, YAW] = wrap_angle(self.mean[:, YAW])
        self.mean[:, SIZE] = np.maximum(self.mean[:, SIZE], SMALLEST_SIZE_M)

    def turn(self, rows: I64) -> None:
        """Turns the boxes of `rows` round by half a turn."""
        self.mean[rows, YAW] = wrap_angle(self.mean[rows, YAW] + np.pi)

    def update_box(self, rows: I64, residual: F64, position: F64, axial: F64) -> None:
        """Corrects `rows` (n,) by box residuals (n, 7); see `BlockBank.update_box`."""
        noise = np.zeros((len(rows), BOX_SIZE, BOX_SIZE))
        noise[:, :2, :2] = position
        axis = np.arange(2, BOX_SIZE)
        noise[:, axis, axis] = axial
        self._correct(rows, slice(0, BOX_SIZE), residual, noise)

    def update_velocity(self, rows: I64, residual: F64, covariance: F64) -> None:
        """Corrects `rows` (n,) by velocity residuals (n, 2) with covariances (n, 2, 2)."""
        self._correct(rows, VELOCITY, residual, covariance)

    def _correct(self, rows: I64, seen: slice, residual: F64, noise: F64) -> None:
        prior = self.covariance[rows]
        innovation = prior[:, seen, seen] + noise
        gain = np.linalg.solve(innovation, prior[:, seen, :]).swapaxes(1, 2)
        keep = np.broadcast_to(np.eye(self.size), prior.shape).copy()
        keep[:, :, seen] -= gain
        posterior = keep @ prior @ keep.swapaxes(1, 2) + gain @ noise @ gain.swapaxes(1, 2)
        self.covariance[rows] = 0.5 * (posterior + posterior.swapaxes(1, 2))
        self.mean[rows] += (gain @ residual[:, :, None])[:, :, 0]
        self.mean[rows, YAW] = wrap_angle(self.mean[rows, YAW])
