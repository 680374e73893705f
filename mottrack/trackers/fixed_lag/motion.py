"""Constant-acceleration motion of the state (x, y, vx, vy, ax, ay), in two dimensions.

`x_1 = F(dt) x_0 + w`, `w ~ N(0, Q(dt))`: the acceleration is a random walk driven by white jerk.
The paper describes the binary factor as "minimise the difference in acceleration"; that alone
leaves position and velocity of two states unlinked, so the factor has all six kinematic rows.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64
from mottrack.trackers.fixed_lag.config import MotionModelConfig

STATE_DIM = 6  # x, y, vx, vy, ax, ay


def transition(dt_s: F64) -> F64:
    """Return `F(dt)` (N, 6, 6) for steps (N,) in seconds."""
    matrix = np.zeros((len(dt_s), STATE_DIM, STATE_DIM))
    matrix[:, range(6), range(6)] = 1.0
    for axis in (0, 1):
        matrix[:, axis, 2 + axis] = dt_s
        matrix[:, 2 + axis, 4 + axis] = dt_s
        matrix[:, axis, 4 + axis] = dt_s**2 / 2
    return matrix


def process_noise(dt_s: F64, model: MotionModelConfig) -> F64:
    """Return `Q(dt)` (N, 6, 6) of white jerk plus the nugget for steps (N,) in seconds."""
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
        matrix[:, rows[:, None], rows] = model.jerk_psd_m2ps5 * one_axis
    matrix[:, range(4), range(4)] += model.nugget_m**2
    return matrix


def predict(mean: F64, covariance: F64, dt_s: F64, model: MotionModelConfig) -> tuple[F64, F64]:
    """Return state (N, 6) and covariance (N, 6, 6) after `dt_s` (N,) of constant acceleration."""
    step = transition(dt_s)
    moved = np.einsum("nij,nj->ni", step, mean)
    return moved, step @ covariance @ step.transpose(0, 2, 1) + process_noise(dt_s, model)
