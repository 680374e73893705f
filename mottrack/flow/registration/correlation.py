"""Where a component might have been: correlation of occupancy over all displacements.

The previous occupancy becomes a map of the distance to the nearest occupied cell; laying the
component over it at every displacement and averaging is a correlation that forgives half a cell.
Its best few minima are the starts of a registration.
"""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64, Mask


@compiled
def distance_map(occupied: Mask, cap: float) -> F32:
    """(H, W) distance in cells to the nearest occupied cell, at most `cap`; 1 / sqrt(2) chamfer."""
    height, width = occupied.shape
    far = np.float32(cap)
    diagonal = np.float32(np.sqrt(2.0))
    one = np.float32(1.0)
    distance = np.where(occupied, np.float32(0.0), far)
    for r in range(1, height):
        for c in range(1, width - 1):
            near = min(distance[r, c - 1], distance[r - 1, c]) + one
            cross = min(distance[r - 1, c - 1], distance[r - 1, c + 1]) + diagonal
            distance[r, c] = min(distance[r, c], near, cross)
    for r in range(height - 2, -1, -1):
        for c in range(width - 2, 0, -1):
            near = min(distance[r, c + 1], distance[r + 1, c]) + one
            cross = min(distance[r + 1, c - 1], distance[r + 1, c + 1]) + diagonal
            distance[r, c] = min(distance[r, c], near, cross)
    return distance


@compiled
def correlation_starts(
    distance: F32,
    cells: I64,
    reach: int,
    step: int,
    count: int,
) -> I64:
    """(K, 2) best displacements (rows, columns) of a component, local minima, best first.

    Args:
        distance: (H, W) capped distance map of the previous occupancy, in cells.
        cells: (M, 2) row and column of the component's cells.
        reach: largest displacement, in steps.
        step: cells between the displacements that are tried; the best go on by single cells.
        count: most displacements that are returned.
    """
    size = 2 * reach + 1
    score = np.full((size + 2, size + 2), np.inf)
    for i in range(size):
        for j in range(size):
            if (i - reach) ** 2 + (j - reach) ** 2 <= reach * reach:
                down, right = step * (i - reach), step * (j - reach)
                score[i + 1, j + 1] = _mean_distance(distance, cells, down, right)
    best: I64 = step * (_lowest_minima(score, count) - 1 - reach)
    if step > 1:
        for k in range(len(best)):
            _descend(distance, cells, best[k], step)
    return best


@compiled
def _lowest_minima(score: F64, count: int) -> I64:
    """(K, 2) row and column of the finite local minima inside the rim, lowest first."""
    minima = np.empty((score.size, 3))
    found = 0
    for i in range(1, score.shape[0] - 1):
        for j in range(1, score.shape[1] - 1):
            here = score[i, j]
            if np.isfinite(here) and here <= score[i - 1 : i + 2, j - 1 : j + 2].min():
                minima[found, 0], minima[found, 1], minima[found, 2] = here, i, j
                found += 1
    order = np.argsort(minima[:found, 0])[:count]
    return minima[order, 1:].astype(np.int64)


@compiled
def _descend(distance: F32, cells: I64, shift: I64, most: int) -> None:
    """Moves a displacement (2,), in place, downhill by single cells, `most` times at most."""
    here = _mean_distance(distance, cells, shift[0], shift[1])
    for _ in range(most):
        best, down, right = here, 0, 0
        for i in range(-1, 2):
            for j in range(-1, 2):
                there = _mean_distance(distance, cells, shift[0] + i, shift[1] + j)
                if there < best:
                    best, down, right = there, i, j
        if best == here:
            return
        here = best
        shift[0] += down
        shift[1] += right


@compiled
def _mean_distance(distance: F32, cells: I64, down: int, right: int) -> float:
    height, width = distance.shape
    total = 0.0
    for k in range(len(cells)):
        r = min(max(cells[k, 0] + down, 0), height - 1)
        c = min(max(cells[k, 1] + right, 0), width - 1)
        total += distance[r, c]
    return total / len(cells)


@compiled
def all_starts(
    distance: F32,
    cells: I64,
    spans: I64,
    wanted: Mask,
    limits: tuple[int, int, int, int],
) -> tuple[I64, I64]:
    """Starts (S, 2) in cells of every wanted component and the first of each (K + 1,).

    Args:
        distance: the capped distance map.
        cells: (M, 2) cell of each point, sorted by component.
        spans: (K + 1,) first point of each component.
        wanted: (K,) components that are correlated.
        limits: reach in steps, cells of a step, starts per component, points per component that
            are laid over.
    """
    count = len(wanted)
    starts = np.empty((count * limits[2], 2), np.int64)
    start_spans = np.zeros(count + 1, np.int64)
    filled = 0
    for k in range(count):
        if wanted[k]:
            stride = max((spans[k + 1] - spans[k]) // limits[3], 1)
            chosen = np.ascontiguousarray(cells[spans[k] : spans[k + 1] : stride])
            found = correlation_starts(distance, chosen, limits[0], limits[1], limits[2])
            starts[filled : filled + len(found)] = found
            filled += len(found)
        start_spans[k + 1] = filled
    return starts[:filled].copy(), start_spans
