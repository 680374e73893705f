"""Connected components of cells: of occupied ones, and of moving ones with similar velocity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64, Floats, Mask
from mottrack.core.grid import BevGrid

_MOVING_REACH = 2
"""Moving cells are linked across one empty cell: a surface seen at an angle has gaps."""
_FRAGMENT_REACH = 4
"""A fragment belongs to what moves alike up to so many cells away: the windows of a car are a gap
of 1.5 m."""


def connected_cells(xy_m: Floats, grid: BevGrid, far_m: float) -> tuple[I64, int]:
    """Return the component of each point (N,), -1 outside the grid, and the number of components.

    Cells are linked to their eight neighbours; beyond `far_m` from the vehicle, where rays are
    further apart, also across one empty cell.
    """
    rows, cols, inside = grid.cells(xy_m)
    occupied = np.zeros(grid.shape, dtype=np.bool_)
    occupied[rows[inside], cols[inside]] = True
    centres_m = grid.centres_m()
    reach = np.where(np.hypot(centres_m[..., 0], centres_m[..., 1]) > far_m, 2, 1)
    labels, count = _flood_fill(occupied, reach, np.zeros((*grid.shape, 2), np.float32), 0.0, 0.0)
    return np.where(inside, labels[rows, cols], -1), count


class Similar(NamedTuple):
    """Largest step of the velocity inside one component."""

    step_mps: float
    share: float
    """The same, as a share of the speed."""


def moving_cells(velocity_mps: F32, usable: Mask, similar: Similar) -> tuple[I64, int]:
    """Return (H, W) the component of each usable cell, -1 elsewhere, and their number.

    Cells up to two apart are linked where their velocities are similar.
    """
    reach = np.full(usable.shape, _MOVING_REACH)
    return _flood_fill(usable, reach, np.array(velocity_mps), similar.step_mps, similar.share)


@compiled
def _flood_fill(
    usable: Mask, reach: I64, velocity_mps: F32, similar_mps: float, similar_share: float
) -> tuple[I64, int]:
    """Label the usable cells (H, W) from 0, -1 elsewhere; return labels and number of components.

    A cell is linked to those up to `reach` (H, W) rows and columns away whose velocity is similar.
    """
    height, width = usable.shape
    labels = np.full((height, width), -1, np.int64)
    queue = np.empty(height * width, np.int64)
    count = 0
    for seed in range(height * width):
        row, col = seed // width, seed % width
        if not usable[row, col] or labels[row, col] >= 0:
            continue
        queue[0], head, tail = seed, 0, 1
        labels[row, col] = count
        while head < tail:
            row, col = queue[head] // width, queue[head] % width
            head += 1
            vx, vy = velocity_mps[row, col, 0], velocity_mps[row, col, 1]
            allowed = max(similar_mps, similar_share * np.sqrt(vx * vx + vy * vy))
            k = reach[row, col]
            for r in range(max(row - k, 0), min(row + k + 1, height)):
                for c in range(max(col - k, 0), min(col + k + 1, width)):
                    if not usable[r, c] or labels[r, c] >= 0:
                        continue
                    dx = velocity_mps[r, c, 0] - vx
                    dy = velocity_mps[r, c, 1] - vy
                    if dx * dx + dy * dy <= allowed * allowed:
                        labels[r, c] = count
                        queue[tail] = r * width + c
                        tail += 1
        count += 1
    return labels, count


@compiled
def owners_of_fragments(cells: I64, velocity_mps: F64, fragment: Mask, similar: Similar) -> I64:
    """Return (K,) the component that each belongs to: itself, and of a fragment its neighbour.

    The neighbour is the nearest component that is none and moves alike.

    Args:
        cells: (H, W) component of each cell, -1 for none.
        velocity_mps: (K, 2) of each component.
        fragment: (K,) components that are fragments.
        similar: how alike.
    """
    owner = np.arange(len(fragment))
    nearest = np.full(len(fragment), np.int64(2 * _FRAGMENT_REACH**2 + 1))
    height, width = cells.shape
    k = _FRAGMENT_REACH
    for row in range(height):
        for col in range(width):
            own = cells[row, col]
            if own < 0 or not fragment[own]:
                continue
            for r in range(max(row - k, 0), min(row + k + 1, height)):
                for c in range(max(col - k, 0), min(col + k + 1, width)):
                    other = cells[r, c]
                    squared = (r - row) ** 2 + (c - col) ** 2
                    if other < 0 or fragment[other] or squared >= nearest[own]:
                        continue
                    vx, vy = velocity_mps[other, 0], velocity_mps[other, 1]
                    dx, dy = velocity_mps[own, 0] - vx, velocity_mps[own, 1] - vy
                    speed = np.sqrt(vx * vx + vy * vy)
                    allowed = max(similar.step_mps, similar.share * speed)
                    if dx * dx + dy * dy <= allowed * allowed:
                        owner[own], nearest[own] = other, squared
    return owner


@compiled
def footprints(shape: tuple[int, int], rows: I64, cols: I64, label_of: I64) -> I64:
    """Return (H, W) the label of each cell from its points, dilated into empty neighbours."""
    height, width = shape
    labels = np.full((height, width), -1, np.int64)
    for i in range(len(rows)):
        labels[rows[i], cols[i]] = label_of[i]
    dilated = labels.copy()
    for r in range(height):
        for c in range(width):
            if labels[r, c] < 0:
                continue
            for i in range(max(r - 1, 0), min(r + 2, height)):
                for j in range(max(c - 1, 0), min(c + 2, width)):
                    if dilated[i, j] < 0:
                        dilated[i, j] = labels[r, c]
    return dilated


@compiled
def medians_of_spans(values: Floats, spans: I64) -> F64:
    """Return (K, D) the medians of rows spans[k] to spans[k + 1] of values (N, D), by column.

    The mean of the two middle values is taken in the precision of the values, as numpy does.
    """
    medians = np.empty((len(spans) - 1, values.shape[1]))
    half = values.dtype.type(0.5)
    for k in range(len(medians)):
        for d in range(values.shape[1]):
            part = np.sort(values[spans[k] : spans[k + 1], d])
            middle = len(part) // 2
            median = part[middle]
            if len(part) % 2 == 0:
                median = (part[middle - 1] + median) * half
            medians[k, d] = median
    return medians
