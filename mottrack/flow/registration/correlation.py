"""Candidate displacements of a component by correlation of occupancy.

The previous occupancy becomes a map of the distance to the nearest occupied cell. The mean of it
under the component, at every displacement, is a correlation that tolerates half a cell. Its lowest
minima are the starts of a registration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64, Mask


class SearchGrid(NamedTuple):
    """The displacements that are tried."""

    radius: int
    """Search radius in steps."""
    step: int
    """Cells of a step; the best displacements are refined by single cells."""
    starts: int
    """Most displacements that are returned for a component."""
    max_points: int
    """Points of a component that are compared."""


@compiled
def distance_map(occupied: Mask, truncation: float) -> F32:
    """Return (H, W) distances in cells to the nearest occupied cell, at most `truncation`.

    Two passes of the 1 / sqrt(2) chamfer (Borgefors, 1986).
    """
    height, width = occupied.shape
    diagonal = np.float32(np.sqrt(2.0))
    one = np.float32(1.0)
    distance = np.where(occupied, np.float32(0.0), np.float32(truncation))
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
def correlate_all(
    distance: F32, cells: I64, spans: I64, wanted: Mask, search: SearchGrid
) -> tuple[I64, I64]:
    """Return the starts (S, 2) in cells of every wanted component and the first of each (K + 1,).

    Args:
        distance: (H, W) truncated distance map of the previous occupancy, in cells.
        cells: (M, 2) row and column of each point, sorted by component.
        spans: (K + 1,) first point of each component.
        wanted: (K,) components that are correlated.
        search: the displacements that are tried.
    """
    count = len(wanted)
    starts = np.empty((count * search.starts, 2), np.int64)
    start_spans = np.zeros(count + 1, np.int64)
    filled = 0
    for k in range(count):
        if wanted[k]:
            stride = max((spans[k + 1] - spans[k]) // search.max_points, 1)
            compared = np.ascontiguousarray(cells[spans[k] : spans[k + 1] : stride])
            found = _correlate(distance, compared, search)
            for i in range(len(found)):
                starts[filled + i, 0], starts[filled + i, 1] = found[i, 0], found[i, 1]
            filled += len(found)
        start_spans[k + 1] = filled
    return starts[:filled].copy(), start_spans


@compiled
def _correlate(distance: F32, cells: I64, search: SearchGrid) -> I64:
    """Return the best displacements (rows, columns) of a component: local minima, best first."""
    radius, step = search.radius, search.step
    size = 2 * radius + 1
    score = np.full((size + 2, size + 2), np.inf)
    for i in range(size):
        for j in range(size):
            if (i - radius) ** 2 + (j - radius) ** 2 <= radius * radius:
                down, right = step * (i - radius), step * (j - radius)
                score[i + 1, j + 1] = _mean_distance(distance, cells, down, right)
    best = step * (_lowest_minima(score, search.starts) - 1 - radius)
    if step > 1:
        for k in range(len(best)):
            _descend(distance, cells, best[k], step)
    return best


@compiled
def _lowest_minima(score: F64, count: int) -> I64:
    """Return row and column (K, 2) of the finite local minima inside the rim, lowest first."""
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
def _descend(distance: F32, cells: I64, shift: I64, max_steps: int) -> None:
    """Move a displacement (2,), in place, downhill by single cells."""
    here = _mean_distance(distance, cells, shift[0], shift[1])
    for _ in range(max_steps):
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
