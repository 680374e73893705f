"""Noise of the filter as arrays, and its growth over a time step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64
from mottrack.trackers.kalman.state import CA_SIZE


@dataclass(frozen=True, slots=True)
class NoiseRows:
    """Noise parameters of N rows (tracks or detections), looked up by class.

    `observation` (N, 7) variances of the box; `along_ratio` (N,) standard deviation of the centre
    along the heading over that across it; `initial` (N, 13) variances of a new state; `process`
    (N, 13) growth per unit of time: of the seven box numbers, the four rates and the acceleration.
    """

    observation: F64
    across_ratio: F64
    along_ratio: F64
    initial: F64
    process: F64

    def select(self, index: NDArray[Any]) -> NoiseRows:
        """The rows that a mask or an index picks."""
        return NoiseRows(
            self.observation[index],
            self.across_ratio[index],
            self.along_ratio[index],
            self.initial[index],
            self.process[index],
        )


def position_covariance(noise: NoiseRows, yaw_rad: F64) -> F64:
    """Covariance (N, 2, 2) of the observed centre: the class's own, stretched along the heading."""
    variance = noise.observation[:, :2]
    if (noise.along_ratio == 1.0).all():
        return _diagonal(variance)
    return _aligned(noise.along_ratio**2 * variance.mean(axis=1), variance.mean(axis=1), yaw_rad)


def initial_velocity_covariance(noise: NoiseRows, yaw_rad: F64) -> F64:
    """Covariance (N, 2, 2) of a new track's velocity: objects drive along their heading."""
    variance = noise.initial[:, 7:9]
    if (noise.across_ratio == 1.0).all():
        return _diagonal(variance)
    return _aligned(variance.mean(axis=1), noise.across_ratio**2 * variance.mean(axis=1), yaw_rad)


def _diagonal(variance: F64) -> F64:
    return np.asarray(variance[:, :, None] * np.eye(2))


def _aligned(along: F64, across: F64, yaw_rad: F64) -> F64:
    """Covariances with the variances `along` (N,) the heading and `across` (N,) it."""
    heading = np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=1)
    stretch = (along - across)[:, None, None] * heading[:, :, None] * heading[:, None, :]
    return np.asarray(across[:, None, None] * np.eye(2) + stretch)


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


def process_covariance(process: F64, dt_s: F64, model: str, size: int, wiener: bool) -> F64:
    """Q (N, D, D) of a motion model over a step; `process` (N, 13) per unit of time."""
    full = np.zeros((len(process), size, size))
    var, cross, rate = pair_growth(process, dt_s, wiener)
    if model == "ca":
        var[:, :2], cross[:, :2], rate[:, :2] = _jerk_growth(process, dt_s)
    pair = np.arange(4)
    full[:, pair, pair], full[:, pair + 7, pair + 7] = var, rate
    full[:, pair, pair + 7] = full[:, pair + 7, pair] = cross
    axis = np.arange(4, 7)
    full[:, axis, axis] = process[:, 4:7] * dt_s[:, None]
    if size == CA_SIZE:
        _add_acceleration(full, process[:, 11:], dt_s, coupled=model == "ca")
    return full


def _jerk_growth(process: F64, dt_s: F64) -> tuple[F64, F64, F64]:
    """Position and velocity under white jerk j: j t^5 / 20, j t^4 / 8, j t^3 / 3."""
    dt, jerk = dt_s[:, None], process[:, 11:]
    return process[:, :2] * dt + jerk * dt**5 / 20, jerk * dt**4 / 8, jerk * dt**3 / 3


def _add_acceleration(full: F64, jerk: F64, dt_s: F64, *, coupled: bool) -> None:
    """Noise of (a_x, a_y): white jerk, or, for models without it, a spread about zero."""
    dt = dt_s[:, None]
    axis, speed, force = np.arange(2), np.arange(7, 9), np.arange(11, 13)
    full[:, force, force] = jerk * (dt if coupled else 1.0)
    if coupled:
        full[:, axis, force] = full[:, force, axis] = jerk * dt**3 / 6
        full[:, speed, force] = full[:, force, speed] = jerk * dt**2 / 2
