"""The readable reference: one filterpy filter a track, constant velocity, column vectors."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.pose import wrap_angle
from mottrack.trackers.kalman.noise_model import process_covariance
from mottrack.trackers.kalman.state import (
    BOX_SIZE,
    CV_SIZE,
    MOVING,
    PLANAR,
    RATE,
    SIZE,
    SMALLEST_SIZE_M,
    VELOCITY,
    YAW,
)

OBSERVE_BOX = np.eye(CV_SIZE)[:BOX_SIZE]
OBSERVE_VELOCITY = np.eye(CV_SIZE)[VELOCITY]


class FilterpyBank:
    """Same interface and numbers as `BlockBank`, a Python object per track."""

    size = CV_SIZE

    def __init__(self, *, wiener: bool) -> None:
        self._wiener = wiener
        self._filters: list[KalmanFilter] = []

    def __len__(self) -> int:
        return len(self._filters)

    @property
    def mean(self) -> F64:
        """(N, 11) states."""
        return np.array([f.x[:, 0] for f in self._filters]).reshape(-1, CV_SIZE)

    @property
    def covariance(self) -> F64:
        """(N, 11, 11) covariances."""
        return np.array([f.P for f in self._filters]).reshape(-1, CV_SIZE, CV_SIZE)

    def planar_covariance(self) -> F64:
        """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
        return self.covariance[:, np.array(PLANAR)[:, None], PLANAR]

    def axial_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        return np.diagonal(self.covariance, axis1=1, axis2=2)[:, 2:7]

    def append(self, mean: F64, variance: F64, velocity_covariance: F64, model: I64) -> None:
        """Adds n tracks; see `DenseBank.append`."""
        for x, p, v in zip(mean, variance, velocity_covariance, strict=True):
            new = KalmanFilter(dim_x=CV_SIZE, dim_z=BOX_SIZE)
            new.x = x[:, None].copy()
            new.P = np.diag(p)
            new.P[VELOCITY, VELOCITY] = v
            self._filters.append(new)

    def keep(self, mask: Mask) -> None:
        """Drops every track outside the mask (N,)."""
        self._filters = [f for f, kept in zip(self._filters, mask, strict=True) if kept]

    def predict(self, dt_s: F64, process: F64) -> None:
        """Advances every filter; see `DenseBank.predict`."""
        growth = process_covariance(process, dt_s, "cv", CV_SIZE, self._wiener)
        for one, dt, q in zip(self._filters, dt_s, growth, strict=True):
            transition = np.eye(CV_SIZE)
            transition[MOVING, RATE] = dt * np.eye(4)
            one.predict(F=transition, Q=q)
            one.x[YAW] = wrap_angle(one.x[YAW])
            one.x[SIZE] = np.maximum(one.x[SIZE], SMALLEST_SIZE_M)

    def turn(self, rows: I64) -> None:
        """Turns the boxes of `rows` round by half a turn."""
        for row in rows.tolist():
            self._filters[row].x[YAW] = wrap_angle(self._filters[row].x[YAW] + np.pi)

    def update_box(self, rows: I64, residual: F64, position: F64, axial: F64) -> None:
        """Corrects `rows` (n,) by box residuals (n, 7); see `BlockBank.update_box`."""
        for row, y, p, a in zip(rows.tolist(), residual, position, axial, strict=True):
            noise = np.diag(np.concatenate([[0.0, 0.0], a]))
            noise[:2, :2] = p
            self._correct(row, OBSERVE_BOX, y, noise)

    def update_velocity(self, rows: I64, residual: F64, covariance: F64) -> None:
        """Corrects `rows` (n,) by velocity residuals (n, 2) with covariances (n, 2, 2)."""
        for row, y, r in zip(rows.tolist(), residual, covariance, strict=True):
            self._correct(row, OBSERVE_VELOCITY, y, r)

    def _correct(self, row: int, observe: F64, residual: F64, noise: F64) -> None:
        one = self._filters[row]
        one.update(observe @ one.x + residual[:, None], R=noise, H=observe)
        one.x[YAW] = wrap_angle(one.x[YAW])
