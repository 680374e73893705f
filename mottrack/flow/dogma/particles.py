"""Particles as a structure of arrays, their assignment to cells, and velocity moments per cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I32
from mottrack.flow.dogma.window import CellBounds, Window
from mottrack.flow.dogma.workers import Span, Workers


class Particles(NamedTuple):
    """N hypotheses of position and velocity, all of the same mass.

    The paper gives every particle a weight. A LiDAR without Doppler cannot distinguish the
    particles of a cell (its likelihood g is one for all of them), so they share the cell's mass
    equally, and systematic resampling makes the share of all particles the same.
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
        """Return `count` particles at rest in the corner of the window."""
        return cls(*(np.zeros(count, np.float32) for _ in range(4)))


class Assignment(NamedTuple):
    """Which particles lie in which cell; cell = row * cols + col."""

    order: I32
    """(N,) particle indices sorted by cell, ascending within a cell; those outside come last."""
    start: I32
    """(cells + 1,) `order[start[c]:start[c + 1]]` are the particles of cell c."""


class Moments(NamedTuple):
    """Velocity of the persistent particles of every cell, in world axes; 0 where there are none."""

    velocity_mps: F32
    """(rows, cols, 2) mean."""
    covariance_m2ps2: F32
    """(rows, cols, 3) variance along x, covariance, variance along y."""


def assign(particles: Particles, window: Window, before: Window, workers: Workers) -> Assignment:
    """Sort the particles by cell; a stable sort, so the order does not depend on threads.

    Only cells that were in the window `before` can hold particles: what lay beyond its edge was
    unknown, and whatever is seen there now would seem to have crossed the edge with the vehicle.
    """
    count = len(particles.x_m)
    cell, order = np.empty(count, np.int32), np.empty(count, np.int32)
    workers.run(_cells, count, particles, window, window.kept_from(before), cell)
    start = _counting_sort(cell, window.rows * window.cols, order)
    return Assignment(order, start)


@compiled(nogil=True)
def _cells(span: Span, particles: Particles, window: Window, kept: CellBounds, cell: I32) -> None:
    outside = window.rows * window.cols
    per_m = np.float32(1.0 / window.cell_m)
    row_start, row_stop, col_start, col_stop = kept
    for i in range(span[0], span[1]):
        col = int(np.floor(particles.x_m[i] * per_m))
        row = int(np.floor(particles.y_m[i] * per_m))
        inside = (row >= row_start) & (row < row_stop) & (col >= col_start) & (col < col_stop)
        cell[i] = row * window.cols + col if inside else outside


@compiled(nogil=True)
def _counting_sort(cell: I32, cells: int, order: I32) -> I32:
    """Fill `order` and return the start of every cell; `cells` is the number of those outside."""
    fill = np.zeros(cells + 2, np.int32)
    for i in range(len(cell)):
        fill[cell[i] + 1] += 1
    for c in range(cells + 1):
        fill[c + 1] += fill[c]
    start = fill[: cells + 1].copy()
    for i in range(len(cell)):
        order[fill[cell[i]]] = i
        fill[cell[i]] += 1
    return start


def velocity_moments(
    particles: Particles, assignment: Assignment, shape: tuple[int, int], workers: Workers
) -> Moments:
    """Return mean sum(w v) / rho_p and variance sum(w v^2) / rho_p - v^2; w is equal in a cell."""
    cells = shape[0] * shape[1]
    moments = Moments(np.zeros((cells, 2), np.float32), np.zeros((cells, 3), np.float32))
    workers.run(_moments, cells, particles, assignment, moments)
    return Moments(*(values.reshape(*shape, -1) for values in moments))


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
