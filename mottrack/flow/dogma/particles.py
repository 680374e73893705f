"""Particles as a structure of arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F32


class Particles(NamedTuple):
    """N hypotheses of position and velocity, all of the same mass.

    The paper gives every particle a weight. A LiDAR without Doppler cannot tell the particles of a
    cell apart (its likelihood g is one for all of them), so they share the cell's mass equally and
    systematic resampling makes the share of all particles the same: one number for all of them.
    """

    x_m: F32
    """(N,) position along world x, from the window's corner."""
    y_m: F32
    """(N,) position along world y, from the window's corner."""
    vx_mps: F32
    """(N,) velocity along world x."""
    vy_mps: F32
    """(N,) velocity along world y."""

    @classmethod
    def empty(cls, count: int) -> Particles:
        """`count` particles at rest in the corner of the window."""
        return cls(*(np.zeros(count, np.float32) for _ in range(4)))
