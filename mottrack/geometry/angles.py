"""Angles one at a time for kernels, and headings whose front is not known."""

from __future__ import annotations

import math

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64
from mottrack.core.pose import wrap_angle


@compiled
def wrapped(angle_rad: float) -> float:
    """Return the angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@compiled
def modulo_pi(angle_rad: float) -> float:
    """Return the angle in [-pi/2, pi/2): front and rear of a box look alike."""
    return (angle_rad + 0.5 * math.pi) % math.pi - 0.5 * math.pi


def heading_residual(difference_rad: F64) -> F64:
    """Return differences of headings modulo pi, in [-pi/2, pi/2]: front and rear look alike."""
    full = wrap_angle(difference_rad)
    return np.where(
        full > np.pi / 2,
        full - np.pi,
        np.where(full < -np.pi / 2, full + np.pi, full),
    )
