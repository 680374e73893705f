"""Points sorted into square cells for neighbour searches of bounded radius, and voxel thinning.

A k-d tree spends most of its time descending. The points of a sweep are spread over a plane and the
search radius is known beforehand, so a grid of cells of about that size needs no descent: the
neighbours of a point lie in the cells around it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I64
from mottrack.core.checks import as_array
from mottrack.core.errors import InputError


class PointGrid(NamedTuple):
    """Points sorted by cell; `start[c]:start[c + 1]` are the points of cell `c = row * cols + col`.

    A named tuple, so that numba takes it as one argument. Points outside the extent are left out.
    """

    xyz_m: F32
    """(M, 3) points inside the extent, sorted by cell; metres, frame of the input."""
    order: I64
    """(M,) index of each sorted point in the input."""
    start: I64
    """(rows * cols + 1,) first point of each cell."""
    x_min_m: float
    y_min_m: float
    cell_m: float
    rows: int
    cols: int


class CellRange(NamedTuple):
    """Rows and columns of a `PointGrid`, first and last included; empty if last < first."""

    col_low: int
    col_high: int
    row_low: int
    row_high: int


def build_point_grid(xyz_m: F32, cell_m: float, reach_m: float = 60.0) -> PointGrid:
    """Sort `xyz_m` (N, 3) into cells of `cell_m` metres over [-reach_m, reach_m] in x and y.

    Raises:
        InputError: `xyz_m` has another shape, or `cell_m` or `reach_m` is not positive.
    """
    points = np.array(as_array("xyz_m", xyz_m, np.float32, (None, 3)), order="C")
    if not cell_m > 0 or not reach_m > 0:
        raise InputError("cell_m, reach_m", (cell_m, reach_m), "positive metres")
    cells = int(np.ceil(2 * reach_m / cell_m))
    order, start = _counting_sort(points, -reach_m, cell_m, cells)
    return PointGrid(
        points.take(order, axis=0), order, start, -reach_m, -reach_m, cell_m, cells, cells
    )


@compiled
def _counting_sort(xyz_m: F32, low_m: float, cell_m: float, cells: int) -> tuple[I64, I64]:
    start = np.zeros(cells * cells + 1, np.int64)
    cell_of = np.empty(len(xyz_m), np.int64)
    for i in range(len(xyz_m)):
        col = int(np.floor((xyz_m[i, 0] - low_m) / cell_m))
        row = int(np.floor((xyz_m[i, 1] - low_m) / cell_m))
        inside = 0 <= col < cells and 0 <= row < cells
        cell_of[i] = row * cells + col if inside else -1
        if inside:
            start[cell_of[i] + 1] += 1
    for c in range(cells * cells):
        start[c + 1] += start[c]
    order = np.empty(start[-1], np.int64)
    fill = start[:-1].copy()
    for i in range(len(xyz_m)):
        if cell_of[i] >= 0:
            order[fill[cell_of[i]]] = i
            fill[cell_of[i]] += 1
    return order, start


@compiled
def cells_within(
    grid: PointGrid, x_low_m: float, x_high_m: float, y_low_m: float, y_high_m: float
) -> CellRange:
    """Return the cells of the grid that meet a rectangle."""
    return CellRange(
        max(int((x_low_m - grid.x_min_m) // grid.cell_m), 0),
        min(int((x_high_m - grid.x_min_m) // grid.cell_m), grid.cols - 1),
        max(int((y_low_m - grid.y_min_m) // grid.cell_m), 0),
        min(int((y_high_m - grid.y_min_m) // grid.cell_m), grid.rows - 1),
    )


@compiled(fastmath=True)
def nearest(
    grid: PointGrid, x_m: float, y_m: float, z_m: float, gate_m: float
) -> tuple[int, float]:
    """Return sorted index and squared 3-D distance of the nearest point within `gate_m`.

    (-1, gate_m^2) if there is none. The cell of the place comes first: it bounds the search. Then
    come its row and the neighbouring rows outwards, each as far as a nearer point could lie in it.
    """
    own_col, own_row = (x_m - grid.x_min_m) / grid.cell_m, (y_m - grid.y_min_m) / grid.cell_m
    middle = int(np.floor(own_row))
    best, best_d2 = _nearest_in_cell(grid, x_m, y_m, z_m, gate_m * gate_m)
    for step in range(2 * int(np.ceil(gate_m / grid.cell_m)) + 1):
        row = middle + ((step + 1) // 2 if step % 2 else -(step // 2))
        gap = max(row - own_row, own_row - row - 1, 0.0) * grid.cell_m
        if gap * gap >= best_d2 or row < 0 or row >= grid.rows:
            continue
        half = np.sqrt(best_d2 - gap * gap) / grid.cell_m
        col_low = max(int(np.floor(own_col - half)), 0)
        col_high = min(int(np.floor(own_col + half)), grid.cols - 1)
        if col_low > col_high:
            continue
        first = grid.start[row * grid.cols + col_low]
        last = grid.start[row * grid.cols + col_high + 1]
        for k in range(first, last):
            dx = grid.xyz_m[k, 0] - x_m
            dy = grid.xyz_m[k, 1] - y_m
            dz = grid.xyz_m[k, 2] - z_m
            d2 = dx * dx + dy * dy + dz * dz
            if d2 < best_d2:
                best, best_d2 = k, d2
    return best, best_d2


@compiled(fastmath=True)
def _nearest_in_cell(
    grid: PointGrid, x_m: float, y_m: float, z_m: float, best_d2: float
) -> tuple[int, float]:
    """Return the nearest point of the cell that holds a place, if nearer than `best_d2`."""
    best = -1
    col = int(np.floor((x_m - grid.x_min_m) / grid.cell_m))
    row = int(np.floor((y_m - grid.y_min_m) / grid.cell_m))
    if not (0 <= col < grid.cols and 0 <= row < grid.rows):
        return best, best_d2
    cell = row * grid.cols + col
    for k in range(grid.start[cell], grid.start[cell + 1]):
        dx = grid.xyz_m[k, 0] - x_m
        dy = grid.xyz_m[k, 1] - y_m
        dz = grid.xyz_m[k, 2] - z_m
        d2 = dx * dx + dy * dy + dz * dz
        if d2 < best_d2:
            best, best_d2 = k, d2
    return best, best_d2


def first_in_voxel(xyz_m: F32, voxel_m: float) -> I64:
    """Return the ascending indices of the first point of (N, 3) in each cube of `voxel_m` metres.

    Points farther than 2^20 voxels from the origin may share the voxel of another one.

    Raises:
        InputError: `xyz_m` has another shape.
    """
    return _first(np.array(as_array("xyz_m", xyz_m, np.float32, (None, 3))), voxel_m)


@compiled
def _first(xyz_m: F32, voxel_m: float) -> I64:
    """Fill a hash table of voxels (open addressing, at most half full)."""
    size = 1
    while size < 2 * len(xyz_m) + 1:
        size *= 2
    table = np.full(size, -1, np.int64)
    first, keys = np.empty(len(xyz_m), np.int64), np.empty(len(xyz_m), np.int64)
    count, last = 0, np.int64(-1)
    per_voxel = 1.0 / voxel_m
    for i in range(len(xyz_m)):  # a loop of its own: the compiler takes several points at once
        # 21 bits for each coordinate of the voxel, shifted to be positive
        x = np.int64(np.floor(xyz_m[i, 0] * per_voxel)) + (1 << 20)
        y = np.int64(np.floor(xyz_m[i, 1] * per_voxel)) + (1 << 20)
        z = np.int64(np.floor(xyz_m[i, 2] * per_voxel)) + (1 << 20)
        keys[i] = (x << 42) | (y << 21) | z
    for i in range(len(xyz_m)):
        key = keys[i]
        if key == last:  # neighbouring returns often share a voxel
            continue
        last = key
        # Fibonacci hashing: a multiplier near 2^64 / golden ratio spreads neighbouring keys
        slot = ((key * 0x9E3779B97F4A7C1) >> 20) & (size - 1)
        while table[slot] != -1 and table[slot] != key:
            slot = (slot + 1) & (size - 1)
        if table[slot] == -1:
            table[slot] = key
            first[count] = i
            count += 1
    return first[:count].copy()
