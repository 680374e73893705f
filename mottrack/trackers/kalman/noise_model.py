"""Noise of the filter as arrays, and its growth over a time step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class NoiseRows:
    """Noise parameters of N rows (tracks or detections), looked up by class.

    `observation` (N, 7) variances of the box; `along_ratio` (N,) standard deviation of the centre
    along the heading over that across it; `initial` (N, 13) variances of a new state; `process`
    (N, 13) growth per unit of time: of the seven box numbers, the four rates and the acceleration.
    """

    observation: F64
    along_ratio: F64
    initial: F64
    process: F64

    def select(self, index: NDArray[Any]) -> NoiseRows:
        """The rows that a mask or an index picks."""
        return NoiseRows(
            self.observation[index],
            self.along_ratio[index],
            self.initial[index],
            self.process[index],
        )


def position_covariance(noise: NoiseRows, yaw_rad: F64) -> F64:
    """Covariance (N, 2, 2) of the observed centre: the class's own, stretched along the heading."""
    variance = noise.observation[:, :2]
    covariance = variance[:, :, None] * np.eye(2)
    stretched = noise.along_ratio != 1.0
    if stretched.any():
        along = np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=1)
        extra = (noise.along_ratio**2 - 1.0) * variance.mean(axis=1)
        covariance += (extra[:, None, None]) * along[:, :, None] * along[:, None, :]
    return covariance


def pair_growth(process: F64, dt_s: F64, wiener: bool) -> tuple[F64, F64, F64]:
    """Process noise of the four (position, rate) pairs over a step: var, cov, rate var, (N, 4).

    Continuous white noise (`wiener`), p on the position and q on the rate:
    Q = [[p t + q t^3 / 3, q t^2 / 2], [q t^2 / 2, q t]]. Otherwise Q = diag(p, q) t, which for
    t = 1 frame is the published diagonal.
    """
    dt = dt_s[:, None]
    on_position, on_rate = process[:, :4], process[:, 7:11]
    if not wiener:
        return on_position * dt, np.zeros_like(on_rate), on_rate * dt
    return (
        on_position * dt + on_rate * dt**3 / 3.0,
        on_rate * dt**2 / 2.0,
        on_rate * dt,
    )
