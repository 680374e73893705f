"""Constant-acceleration motion of the state (x, y, vx, vy, ax, ay), in two dimensions.

`x_1 = F(dt) x_0 + w`, `w ~ N(0, Q(dt))`: the acceleration is a random walk driven by white jerk.
The paper words the binary factor as "minimise the difference in acceleration"; that alone leaves
position and velocity of two states unlinked, so the factor carries all six kinematic rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64

STATE_DIM = 6


@dataclass(frozen=True)
class MotionNoise:
    """How far a track may stray from constant acceleration, and what is known of it at birth."""

    jerk_psd_m2ps5: float = 1.0
    """Power spectral density of the white jerk, per axis."""
    nugget_m: float = 0.01
    """Standard deviation added to each position (m) and velocity (m/s) per step.

    Pure white jerk makes Q(0.1 s) so ill-conditioned that GTSAM's Cholesky rejects healthy tracks.
    """
    birth_speed_sigma_mps: float = 10.0
    """Prior of a new track's velocity, per axis, about zero."""
    birth_acceleration_sigma_mps2: float = 3.0
    """Prior of a new track's acceleration, per axis, about zero."""


def transition(dt_s: F64) -> F64:
    """`F(dt)` for each step, (N,) seconds to (N, 6, 6)."""
    matrix = np.zeros((len(dt_s), STATE_DIM, STATE_DIM))
    matrix[:, range(6), range(6)] = 1.0
    for axis in (0, 1):
        matrix[:, axis, 2 + axis] = dt_s
        matrix[:, 2 + axis, 4 + axis] = dt_s
        matrix[:, axis, 4 + axis] = dt_s**2 / 2
    return matrix


def process_noise(dt_s: F64, noise: MotionNoise) -> F64:
    """`Q(dt)` of white jerk plus the nugget, (N,) seconds to (N, 6, 6)."""
    one_axis = np.empty((len(dt_s), 3, 3))
    one_axis[:, 0, 0] = dt_s**5 / 20
    one_axis[:, 0, 1] = one_axis[:, 1, 0] = dt_s**4 / 8
    one_axis[:, 0, 2] = one_axis[:, 2, 0] = dt_s**3 / 6
    one_axis[:, 1, 1] = dt_s**3 / 3
    one_axis[:, 1, 2] = one_axis[:, 2, 1] = dt_s**2 / 2
    one_axis[:, 2, 2] = dt_s
    matrix = np.zeros((len(dt_s), STATE_DIM, STATE_DIM))
    for axis in (0, 1):
        rows = np.arange(axis, 6, 2)
        matrix[:, rows[:, None], rows] = noise.jerk_psd_m2ps5 * one_axis
    matrix[:, range(4), range(4)] += noise.nugget_m**2
    return matrix


def square_root_information(covariance: F64) -> F64:
    """`W` with `W^T W = C^-1` for each covariance (N, D, D), lower triangular."""
    root: F64 = np.linalg.inv(np.linalg.cholesky(covariance))
    return root


def planar_root_information(covariance: F64) -> F64:
    """The same in closed form for covariances (N, 2, 2)."""
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    across = np.sqrt(xx)
    along = np.sqrt(yy - xy**2 / xx)
    root = np.zeros_like(covariance)
    root[:, 0, 0] = 1.0 / across
    root[:, 1, 0] = -xy / (xx * along)
    root[:, 1, 1] = 1.0 / along
    return root


def predict(mean: F64, covariance: F64, dt_s: F64, noise: MotionNoise) -> tuple[F64, F64]:
    """State (N, 6) and covariance (N, 6, 6) after `dt_s` (N,) seconds of constant acceleration."""
    step = transition(dt_s)
    moved = np.einsum("nij,nj->ni", step, mean)
    return moved, step @ covariance @ step.transpose(0, 2, 1) + process_noise(dt_s, noise)
