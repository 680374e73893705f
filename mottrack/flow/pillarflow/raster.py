"""The network's own cells beside those of the interface, and what both sweeps saw of them."""

from __future__ import annotations

import math

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I8, I64
from mottrack.core.grid import BevGrid
from mottrack.flow.pillarflow.descriptors import CellGrid
from mottrack.lidar.visibility import FREE, UNSEEN


def network_cells(grid: BevGrid, cell_m: float, multiple: int) -> CellGrid:
    """Cells of the network that cover `grid`, padded at the far edges to a `multiple`."""
    columns = math.ceil((grid.x_max_m - grid.x_min_m) / cell_m - 1e-6)
    rows = math.ceil((grid.y_max_m - grid.y_min_m) / cell_m - 1e-6)
    rows, columns = (math.ceil(n / multiple) * multiple for n in (rows, columns))
    return CellGrid(grid.x_min_m, grid.y_min_m, cell_m, rows, columns)


def cell_of_centres(grid: BevGrid, cells: CellGrid) -> I64:
    """(H,W) flat network cell that holds the centre of each cell of `grid`."""
    centres = grid.centres_m()
    columns = np.floor((centres[..., 0] - cells.x_min_m) / cells.cell_m)
    rows = np.floor((centres[..., 1] - cells.y_min_m) / cells.cell_m)
    return (rows * cells.columns + columns).astype(np.int64)


def seen_shares(
    seen: tuple[I8 | None, I8 | None],
    index: I64,
    cells: CellGrid,
) -> F32:
    """(4,rows,columns) unseen and seen-free shares of the current, then the previous sweep.

    `seen` are the (H,W) rasters (current, previous) of `lidar.visibility`; all zero, which stands
    for "not known", where there is none.
    """
    channels = np.zeros((4, cells.rows, cells.columns), np.float32)
    for which, raster in enumerate(seen):
        if raster is not None:
            _shares(raster.ravel(), index.ravel(), channels[2 * which :].reshape(-1, cells.cells))
    return channels


@compiled
def _shares(states: I8, index: I64, shares: F32) -> None:
    """Fills (2+,cells): of the interface cells inside each network cell, those unseen and free."""
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
    """(N,4) x, y, height above ground, reflectance: what a pillar sees of a point."""
    return np.column_stack((xyz_m[:, :2], height_m, reflectance)).astype(np.float32)
