"""Densities of measured velocities, correct and failed, as the compiled kernels read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.geometry.two_by_two import Symmetric, determinant_of, inverse_quadratic_of

SMALLEST = 1e-200
"""Lower bound of a density: what no hypothesis explains changes no probability."""


class Failures(NamedTuple):
    """How velocities err, in the tracker's unit of time, as the kernels read it."""

    p_missed: float
    p_slow: float
    slow_speed: float
    p_outlier: float
    """Of moving objects."""
    outlier_variance: float
    p_outlier_standing: float
    rest_scale: float
    """Covariance of the velocities of standing objects over that of moving ones."""

    @classmethod
    def of(cls, model: VelocityErrorModel, unit_s: float) -> Failures:
        """Return the model's numbers; `unit_s` is the length of the unit of time in seconds."""
        return cls(
            float(model.p_missed_motion),
            float(model.p_missed_slow),
            model.missed_speed_mps * unit_s,
            float(model.p_outlier),
            (model.outlier_sigma_mps * unit_s) ** 2,
            float(model.p_outlier),
            1.0,
        )


@compiled
def missed_share(failures: Failures, x: float, y: float, p: Symmetric) -> float:
    """Return p_missed of one track with velocity N((x, y), p).

    The mean of exp(-u^2 / 2 s^2) over u ~ N(d, p) is 2 pi s^2 N(d; 0, p + s^2 I).
    """
    if failures.p_slow == 0.0:
        return float(failures.p_missed)
    s = failures.slow_speed**2
    wide = _widened(p, s)
    slow = s / np.sqrt(determinant_of(wide)) * np.exp(-0.5 * inverse_quadratic_of(wide, x, y))
    return float(failures.p_missed + failures.p_slow * slow)


@compiled
def normal_density(x: float, y: float, s: Symmetric) -> float:
    """Return N((x, y); 0, s)."""
    scale = 2.0 * np.pi * np.sqrt(determinant_of(s))
    return float(np.exp(-0.5 * inverse_quadratic_of(s, x, y)) / scale)


@compiled
def isotropic_density(x: float, y: float, variance: float, s: Symmetric) -> float:
    """Return N((x, y); 0, s + variance I)."""
    return normal_density(x, y, _widened(s, variance))


@compiled
def _widened(s: Symmetric, variance: float) -> Symmetric:
    return Symmetric(s.xx + variance, s.xy, s.yy + variance)
