"""The nine numbers that describe a point inside its pillar (paper, section III-A).

D = 9: x, y, z, r, the offsets x_c, y_c, z_c to the mean of the pillar's points and x_p, y_p to
the pillar's centre; here brought to the order of one (positions x 0.02, height x 0.5, offsets in
cells).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I64, Mask

DESCRIPTORS = 9


@dataclass(frozen=True)
class CellGrid:
    """Square cells over the ground; row = floor((y - y_min) / cell), column likewise in x."""

    x_min_m: float
    y_min_m: float
    cell_m: float
    rows: int
    columns: int

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.rows * self.columns


@compiled(nogil=True)
def _place(points: F32, origin: F32, cell_m: float, shape: tuple[int, int]) -> I64:
    cells = np.empty(len(points), np.int64)
    for i in range(len(points)):
        column = int(np.floor((points[i, 0] - origin[0]) / cell_m))
        row = int(np.floor((points[i, 1] - origin[1]) / cell_m))
        inside = 0 <= row < shape[0] and 0 <= column < shape[1]
        cells[i] = row * shape[1] + column if inside else -1
    return cells


@compiled(nogil=True)
def _means(points: F32, cells: I64, count: int) -> F32:
    sums = np.zeros((count, 4), np.float32)
    for i in range(len(points)):
        if cells[i] >= 0:
            for axis in range(3):
                sums[cells[i], axis] += points[i, axis]
            sums[cells[i], 3] += 1.0
    for cell in range(count):
        if sums[cell, 3] > 0.0:
            for axis in range(3):
                sums[cell, axis] /= sums[cell, 3]
    return sums


@compiled(nogil=True)
def _describe(
    points: F32,
    cells: I64,
    means: F32,
    frame: tuple[F32, float, int],
) -> F32:
    origin, cell_m, columns = frame
    out = np.empty((len(points), 9), np.float32)
    for i in range(len(points)):
        cell = cells[i]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        out[i, 0], out[i, 1] = x * 0.02, y * 0.02
        out[i, 2], out[i, 3] = z * 0.5, points[i, 3]
        out[i, 4], out[i, 5] = (x - means[cell, 0]) / cell_m, (y - means[cell, 1]) / cell_m
        out[i, 6] = (z - means[cell, 2]) / cell_m
        out[i, 7] = (x - origin[0]) / cell_m - (cell % columns) - 0.5
        out[i, 8] = (y - origin[1]) / cell_m - (cell // columns) - 0.5
    return out


def place(points: F32, grid: CellGrid) -> I64:
    """Flat cell of each point (N,4), -1 outside of the grid."""
    origin = np.array([grid.x_min_m, grid.y_min_m], np.float32)
    cells: I64 = _place(points, origin, grid.cell_m, (grid.rows, grid.columns))
    return cells


def describe(points: F32, grid: CellGrid) -> tuple[F32, I64, Mask]:
    """Points (N,4) x,y,z,r [m] -> descriptors (M,9) and flat cell (M,) of those inside (N,)."""
    cells = place(points, grid)
    inside = cells >= 0
    points, cells = np.ascontiguousarray(points[inside]), cells[inside]
    origin = np.array([grid.x_min_m, grid.y_min_m], np.float32)
    means = _means(points, cells, grid.cells)
    described = _describe(points, cells, means, (origin, grid.cell_m, grid.columns))
    return described, cells, inside
