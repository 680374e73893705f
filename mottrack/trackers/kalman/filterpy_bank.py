"""Readable reference engine: one filterpy filter per track."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.pose import wrap_angle
from mottrack.geometry.angles import modulo_pi
from mottrack.trackers.kalman.moments import Moments, mixture
from mottrack.trackers.kalman.noise import process_covariance
from mottrack.trackers.kalman.observations import Matched, Observation, SeenBoxes
from mottrack.trackers.kalman.state import (
    BOX_SIZE,
    POSE,
    RATE,
    SIZE,
    SMALLEST_SIZE_M,
    STATE_SIZE,
    VELOCITY,
    XY_VELOCITY,
    YAW,
)

OBSERVE_BOX = np.eye(STATE_SIZE)[:BOX_SIZE]
OBSERVE_YAW = np.eye(STATE_SIZE)[[YAW]]
OBSERVE_VELOCITY = np.eye(STATE_SIZE)[VELOCITY]


class FilterpyBank:
    """Same interface and numbers as `BlockBank`, with column vectors and dense matrices."""

    def __init__(self, *, wiener: bool) -> None:
        self._wiener = wiener
        self._filters: list[KalmanFilter] = []

    def __len__(self) -> int:
        return len(self._filters)

    @property
    def filters(self) -> tuple[F64, F64]:
        """(N, 11) states, and covariances (N, 4, 4) of (x, y, d_x, d_y)."""
        mean = np.array([f.x[:, 0] for f in self._filters]).reshape(-1, STATE_SIZE)
        planar = self._covariances()[:, np.array(XY_VELOCITY)[:, None], XY_VELOCITY]
        return mean, np.ascontiguousarray(planar)

    @property
    def z_yaw_size_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        variance = np.diagonal(self._covariances(), axis1=1, axis2=2)
        return np.ascontiguousarray(variance[:, 2:7])

    def covariance(self, rows: I64) -> F64:
        """Return the covariances (n, 11, 11) of `rows` (n,)."""
        return self._covariances()[rows]

    def append(self, mean: F64, variance: F64, velocity_covariance: F64) -> None:
        """Add n tracks; see `Bank.append`."""
        for x, p, v in zip(mean, variance, velocity_covariance, strict=True):
            new = KalmanFilter(dim_x=STATE_SIZE, dim_z=BOX_SIZE)
            new.x = x[:, None].copy()
            new.P = np.diag(p)
            new.P[VELOCITY, VELOCITY] = v
            self._filters.append(new)

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        self._filters = [f for f, kept in zip(self._filters, mask, strict=True) if kept]

    def predict(self, dt_s: F64, process: F64) -> None:
        """Advance every filter; see `Bank.predict`."""
        growth = process_covariance(process, dt_s, self._wiener)
        for one, dt, q in zip(self._filters, dt_s, growth, strict=True):
            transition = np.eye(STATE_SIZE)
            transition[POSE, RATE] = dt * np.eye(4)
            one.predict(F=transition, Q=q)
            one.x[YAW] = wrap_angle(one.x[YAW])
            one.x[SIZE] = np.maximum(one.x[SIZE], SMALLEST_SIZE_M)

    def flip_heading(self, rows: I64) -> None:
        """Add pi to the headings of `rows`."""
        for row in rows.tolist():
            self._filters[row].x[YAW] = wrap_angle(self._filters[row].x[YAW] + np.pi)

    def update_box(self, matched: Matched, seen: SeenBoxes) -> None:
        """Correct the matched tracks by their boxes; see `Bank.update_box`."""
        noise = np.zeros((len(seen.box), BOX_SIZE, BOX_SIZE))
        noise[:, :2, :2] = seen.xy_covariance
        noise[:, range(2, BOX_SIZE), range(2, BOX_SIZE)] = seen.z_yaw_size_variance
        for row, column in zip(*(side.tolist() for side in matched), strict=True):
            residual = seen.box[column] - self._filters[row].x[:BOX_SIZE, 0]
            residual[YAW] = modulo_pi(residual[YAW])
            self._correct(row, OBSERVE_BOX, residual, noise[column])

    def update_yaw(self, rows: I64, residual: F64, variance: F64) -> None:
        """Correct the headings of `rows` (n,); see `Bank.update_yaw`."""
        for row, y, r in zip(rows.tolist(), residual, variance, strict=True):
            self._correct(row, OBSERVE_YAW, np.array([y]), np.array([[r]]))

    def update_velocity(self, rows: I64, velocity: Observation, weight: F64) -> None:
        """Correct `rows` (n,) by velocities that are correct with `weight`; see `Bank`."""
        for row, v, r, w in zip(rows.tolist(), *velocity, weight, strict=True):
            one = self._filters[row]
            before = Moments(one.x.T.copy(), one.P[None].copy())
            self._correct(row, OBSERVE_VELOCITY, v - one.x[VELOCITY, 0], r)
            if w < 1.0:
                after = Moments(one.x.T, one.P[None])
                mixed = mixture(before, after, np.array([w]))
                one.x, one.P = mixed.mean.T, mixed.covariance[0]

    def _covariances(self) -> F64:
        return np.array([f.P for f in self._filters]).reshape(-1, STATE_SIZE, STATE_SIZE)

    def _correct(self, row: int, observe: F64, residual: F64, noise: F64) -> None:
        one = self._filters[row]
        one.update(observe @ one.x + residual[:, None], R=noise, H=observe)
        one.x[YAW] = wrap_angle(one.x[YAW])
