"""Mean and covariance of the velocity of every cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32
from mottrack.flow.dogma.assign import Assignment
from mottrack.flow.dogma.particles import Particles
from mottrack.flow.dogma.workers import Span, Workers


class Moments(NamedTuple):
    """Velocity of the persistent particles of every cell, in world axes; 0 where there are none."""

    velocity_mps: F32
    """(rows, cols, 2) mean."""
    covariance_m2ps2: F32
    """(rows, cols, 3) variance along x, covariance, variance along y."""


def velocity_moments(
    particles: Particles, assignment: Assignment, shape: tuple[int, int], workers: Workers
) -> Moments:
    """Mean sum(w v) / rho_p and variance sum(w v^2) / rho_p - v^2; w is the same within a cell."""
    moments = Moments(np.zeros((*shape, 2), np.float32), np.zeros((*shape, 3), np.float32))
    cells = shape[0] * shape[1]
    flat = Moments(
        moments.velocity_mps.reshape(cells, 2), moments.covariance_m2ps2.reshape(cells, 3)
    )
    workers.run(_moments, cells, particles, assignment, flat)
    return moments


@compiled(nogil=True)
def _moments(cells: Span, particles: Particles, assignment: Assignment, moments: Moments) -> None:
    order, start = assignment.order, assignment.start
    for cell in range(cells[0], cells[1]):
        count = start[cell + 1] - start[cell]
        if count == 0:
            continue
        sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(start[cell], start[cell + 1]):
            vx = np.float64(particles.vx_mps[order[k]])
            vy = np.float64(particles.vy_mps[order[k]])
            sx += vx
            sy += vy
            sxx += vx * vx
            sxy += vx * vy
            syy += vy * vy
        mx, my = sx / count, sy / count
        moments.velocity_mps[cell, 0] = mx
        moments.velocity_mps[cell, 1] = my
        moments.covariance_m2ps2[cell, 0] = max(sxx / count - mx * mx, 0.0)
        moments.covariance_m2ps2[cell, 1] = sxy / count - mx * my
        moments.covariance_m2ps2[cell, 2] = max(syy / count - my * my, 0.0)
