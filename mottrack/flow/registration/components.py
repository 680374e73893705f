"""Connected components of occupied cells."""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I64, Floats, Mask
from mottrack.core.grid import BevGrid


def connected_cells(xy_m: Floats, grid: BevGrid, far_m: float) -> tuple[I64, int]:
    """Component of each point (N,), -1 outside the grid, and how many components there are.

    Cells are linked to their eight neighbours; beyond `far_m` from the vehicle, where rays are
    further apart, also across one empty cell.
    """
    rows, cols, inside = grid.cells(xy_m)
    occupied = np.zeros(grid.shape, dtype=np.bool_)
    occupied[rows[inside], cols[inside]] = True
    centres_m = grid.centres_m()
    reach = np.where(np.hypot(centres_m[..., 0], centres_m[..., 1]) > far_m, 2, 1)
    labels, count = _label(occupied, reach)
    return np.where(inside, labels[rows, cols], -1), int(count)


@compiled
def _label(occupied: Mask, reach: I64) -> tuple[I64, int]:
    """Flood fill: component of each occupied cell, from 0; -1 where empty."""
    height, width = occupied.shape
    labels = np.full((height, width), -1, np.int64)
    queue = np.empty(height * width, np.int64)
    count = 0
    for seed in range(height * width):
        if not occupied[seed // width, seed % width] or labels[seed // width, seed % width] >= 0:
            continue
        queue[0], head, tail = seed, 0, 1
        labels[seed // width, seed % width] = count
        while head < tail:
            row, col = queue[head] // width, queue[head] % width
            head += 1
            k = reach[row, col]
            for r in range(max(row - k, 0), min(row + k + 1, height)):
                for c in range(max(col - k, 0), min(col + k + 1, width)):
                    if occupied[r, c] and labels[r, c] < 0:
                        labels[r, c] = count
                        queue[tail] = r * width + c
                        tail += 1
        count += 1
    return labels, count


def grown_labels(
    shape: tuple[int, int],
    cells: tuple[I64, I64],
    label_of: I64,
) -> I64:
    """(H, W) label of each cell from its points (rows, columns), grown into empty neighbours."""
    labels = np.full(shape, -1, np.int64)
    labels[cells] = label_of
    return np.asarray(_grown(labels))


@compiled
def _grown(labels: I64) -> I64:
    height, width = labels.shape
    grown = labels.copy()
    for r in range(height):
        for c in range(width):
            if labels[r, c] < 0:
                continue
            for i in range(max(r - 1, 0), min(r + 2, height)):
                for j in range(max(c - 1, 0), min(c + 2, width)):
                    if grown[i, j] < 0:
                        grown[i, j] = labels[r, c]
    return grown


def moving_cells(
    velocity_mps: F32,
    usable: Mask,
    limits_mps: tuple[float, float, float],
) -> tuple[I64, int]:
    """(H, W) component of moving cells of similar velocity, -1 elsewhere, and how many.

    `limits_mps`: least speed; largest velocity step inside a component, or its share of the
    speed, whichever is larger. Cells up to two apart are linked.
    """
    labels, count = _label_moving(np.array(velocity_mps), np.array(usable), limits_mps)
    return labels, int(count)


@compiled
def _label_moving(
    velocity_mps: F32,
    usable: Mask,
    limits_mps: tuple[float, float, float],
) -> tuple[I64, int]:
    height, width = usable.shape
    slowest, step, share = limits_mps
    speed = np.sqrt(velocity_mps[..., 0] ** 2 + velocity_mps[..., 1] ** 2)
    labels = np.full((height, width), -1, np.int64)
    queue = np.empty(height * width, np.int64)
    count = 0
    for seed in range(height * width):
        row, col = seed // width, seed % width
        if not usable[row, col] or labels[row, col] >= 0 or speed[row, col] <= slowest:
            continue
        queue[0], head, tail = seed, 0, 1
        labels[row, col] = count
        while head < tail:
            row, col = queue[head] // width, queue[head] % width
            head += 1
            allowed = max(step, share * speed[row, col])
            for r in range(max(row - 2, 0), min(row + 3, height)):
                for c in range(max(col - 2, 0), min(col + 3, width)):
                    if not usable[r, c] or labels[r, c] >= 0 or speed[r, c] <= slowest:
                        continue
                    dx = velocity_mps[r, c, 0] - velocity_mps[row, col, 0]
                    dy = velocity_mps[r, c, 1] - velocity_mps[row, col, 1]
                    if dx * dx + dy * dy <= allowed * allowed:
                        labels[r, c] = count
                        queue[tail] = r * width + c
                        tail += 1
        count += 1
    return labels, count
