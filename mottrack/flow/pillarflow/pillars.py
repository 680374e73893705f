"""Points to pillars: the network's cells, point descriptors, visibility, pseudo-images (III-A).

D = 9 descriptors of a point: x, y, z, r, the offsets x_c, y_c, z_c to the mean of the pillar's
points and x_p, y_p to the pillar's centre. They are scaled to the order of one: positions by
1 / 50 m, heights by 1 / 2 m, offsets by the edge of a cell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I8, I64, Mask
from mottrack.core.grid import BevGrid
from mottrack.lidar.visibility import FREE, UNSEEN

DESCRIPTORS = 9  # numbers that describe a point (paper, section III-A)
_POSITION_SCALE, _HEIGHT_SCALE = 0.02, 0.5
"""1 / 50 m, the paper's half width of the grid; 1 / 2 m, about the height of a van."""


class CellGrid(NamedTuple):
    """Square cells over the ground; row = floor((y - y_min) / cell), column likewise in x."""

    x_min_m: float
    """Lower edge in x, ego frame."""
    y_min_m: float
    """Lower edge in y."""
    cell_m: float
    """Edge of a cell."""
    rows: int
    columns: int

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.rows * self.columns


class DescribedPoints(NamedTuple):
    """The M of N points that lie on a grid, described within their pillars."""

    descriptors: F32
    """(M,9) as above."""
    cells: I64
    """(M,) flat index of the cell."""
    inside: Mask
    """(N,) whether a point lies on the grid."""


def network_cells(grid: BevGrid, cell_m: float, multiple: int) -> CellGrid:
    """Return cells that cover `grid`, padded at the far edges to a `multiple` either way."""
    # the tolerance keeps a quotient such as 200.0000001 from adding a row
    columns = math.ceil((grid.x_max_m - grid.x_min_m) / cell_m - 1e-6)
    rows = math.ceil((grid.y_max_m - grid.y_min_m) / cell_m - 1e-6)
    rows, columns = (math.ceil(n / multiple) * multiple for n in (rows, columns))
    return CellGrid(grid.x_min_m, grid.y_min_m, cell_m, rows, columns)


def cell_of_centres(grid: BevGrid, cells: CellGrid) -> I64:
    """Return (H,W) the flat index of the cell that holds the centre of each cell of `grid`."""
    centres = grid.centres_m()
    columns = np.floor((centres[..., 0] - cells.x_min_m) / cells.cell_m)
    rows = np.floor((centres[..., 1] - cells.y_min_m) / cells.cell_m)
    return (rows * cells.columns + columns).astype(np.int64)


def visibility_shares(
    current_seen: I8 | None, previous_seen: I8 | None, index: I64, cells: CellGrid
) -> F32:
    """Return (4,rows,columns) unseen and seen-free shares of the current, then previous sweep.

    Args:
        current_seen: (H,W) raster of `lidar.visibility`; None where there is none, which gives
            zero for both shares ("not known").
        previous_seen: the same of the previous sweep.
        index: (H,W) of `cell_of_centres` for the grid of the rasters.
        cells: the network's cells.
    """
    channels = np.zeros((4, cells.rows, cells.columns), np.float32)
    for first, raster in ((0, current_seen), (2, previous_seen)):
        if raster is not None:
            _fill_shares(raster.ravel(), index.ravel(), channels[first:].reshape(-1, cells.cells))
    return channels


@compiled
def _fill_shares(states: I8, index: I64, shares: F32) -> None:
    """Fill (2+,cells): of the raster's cells inside each network cell, those unseen and free."""
    total = np.zeros(shares.shape[1], np.float32)
    for i in range(len(states)):
        total[index[i]] += 1.0
        if states[i] == UNSEEN:
            shares[0, index[i]] += 1.0
        elif states[i] == FREE:
            shares[1, index[i]] += 1.0
    for cell in range(len(total)):
        if total[cell] > 0.0:
            shares[0, cell] /= total[cell]
            shares[1, cell] /= total[cell]


def network_points(xyz_m: F32, height_m: F32, reflectance: F32) -> F32:
    """Return (N,4) x, y, height above ground, reflectance: a point as the pillars take it."""
    return np.column_stack((xyz_m[:, :2], height_m, reflectance)).astype(np.float32)


@compiled(nogil=True)
def cell_indices(points: F32, grid: CellGrid) -> I64:
    """Return the flat index of the cell of each point (N,4), -1 outside of the grid."""
    x_min, y_min = np.float32(grid.x_min_m), np.float32(grid.y_min_m)
    cell_m, rows, columns = grid.cell_m, grid.rows, grid.columns
    cells = np.empty(len(points), np.int64)
    for i in range(len(points)):
        column = int(np.floor((points[i, 0] - x_min) / cell_m))
        row = int(np.floor((points[i, 1] - y_min) / cell_m))
        inside = 0 <= row < rows and 0 <= column < columns
        cells[i] = row * columns + column if inside else -1
    return cells


def describe(points: F32, grid: CellGrid) -> DescribedPoints:
    """Describe points (N,4) of `network_points` within their pillars."""
    cells = cell_indices(points, grid)
    inside = cells >= 0
    cells, points = cells[inside], np.ascontiguousarray(points[inside])
    return DescribedPoints(_descriptors(points, cells, grid), cells, inside)


@compiled(nogil=True)
def _descriptors(points: F32, cells: I64, grid: CellGrid) -> F32:
    """Return (M,9) descriptors of points (M,4) on the cells (M,)."""
    means = _means(points, cells, grid.rows * grid.columns)
    x_min, y_min = np.float32(grid.x_min_m), np.float32(grid.y_min_m)
    cell_m, columns = grid.cell_m, grid.columns
    out = np.empty((len(points), DESCRIPTORS), np.float32)
    for i in range(len(points)):
        cell = cells[i]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        out[i, 0], out[i, 1] = x * _POSITION_SCALE, y * _POSITION_SCALE
        out[i, 2], out[i, 3] = z * _HEIGHT_SCALE, points[i, 3]
        out[i, 4], out[i, 5] = (x - means[cell, 0]) / cell_m, (y - means[cell, 1]) / cell_m
        out[i, 6] = (z - means[cell, 2]) / cell_m
        out[i, 7] = (x - x_min) / cell_m - (cell % columns) - 0.5
        out[i, 8] = (y - y_min) / cell_m - (cell // columns) - 0.5
    return out


@compiled(nogil=True)
def _means(points: F32, cells: I64, count: int) -> F32:
    """Return (count,4): mean x, y, z of the points of each cell and their number."""
    sums = np.zeros((count, 4), np.float32)
    for i in range(len(points)):
        for axis in range(3):
            sums[cells[i], axis] += points[i, axis]
        sums[cells[i], 3] += 1.0
    for cell in range(count):
        if sums[cell, 3] > 0.0:
            for axis in range(3):
                sums[cell, axis] /= sums[cell, 3]
    return sums


def pillar_image(points: F32, grid: CellGrid, weight: F32, bias: F32) -> F32:
    """Encode points (N,4) by the folded layer, (C,9) and (C,), in one pass: (rows,columns,C).

    It equals `network.PillarEncoder` in evaluation mode: embed, maximum over the pillar, scatter.
    """
    described = describe(points, grid)
    image = np.zeros((grid.cells, len(bias)), np.float32)
    weight = np.ascontiguousarray(weight.T)
    _embed(described.descriptors, described.cells, weight, bias, image)
    return image.reshape(grid.rows, grid.columns, len(bias))


def binary_image(points: F32, grid: CellGrid) -> F32:
    """Return the occupancy (rows,columns,1) of points (N,4) as 0 and 1."""
    cells = cell_indices(points, grid)
    image = np.zeros((grid.cells, 1), np.float32)
    image[cells[cells >= 0]] = 1.0
    return image.reshape(grid.rows, grid.columns, 1)


@compiled(nogil=True, fastmath=True)
def _embed(descriptors: F32, cells: I64, weight: F32, bias: F32, image: F32) -> None:
    """Raise each pillar's channels to the maximum of its points' embeddings; zero is the ReLU."""
    channels = len(bias)
    embedded = np.empty(channels, np.float32)
    for i in range(len(cells)):
        for c in range(channels):
            embedded[c] = bias[c]
        for d in range(descriptors.shape[1]):
            value = descriptors[i, d]
            for c in range(channels):
                embedded[c] += value * weight[d, c]
        row = image[cells[i]]
        for c in range(channels):
            row[c] = max(row[c], embedded[c])
