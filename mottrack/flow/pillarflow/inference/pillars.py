"""Dynamic pillars in one pass over the points: describe, embed, maximum, scatter (III-A)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mottrack.flow.pillarflow.descriptors import CellGrid, describe, place

Floats = NDArray[np.float32]


def pillar_image(points: Floats, grid: CellGrid, weight: Floats, bias: Floats) -> Floats:
    """Pseudo-image (rows,columns,C) of points (N,4) by the folded layer: (C,9) and (C,)."""
    described, cells, _ = describe(points, grid)
    image = np.zeros((grid.cells, len(bias)), np.float32)
    _embed(described, cells, np.ascontiguousarray(weight.T), bias, image)
    return image.reshape(grid.rows, grid.columns, len(bias))


def binary_image(points: Floats, grid: CellGrid) -> Floats:
    """Occupancy (rows,columns,1) as 0 and 1."""
    cells = place(points, grid)
    image = np.zeros((grid.cells, 1), np.float32)
    image[cells[cells >= 0]] = 1.0
    return image.reshape(grid.rows, grid.columns, 1)


@njit(cache=True, nogil=True, fastmath=True)
def _embed(
    described: Floats, cells: NDArray[np.int64], weight: Floats, bias: Floats, image: Floats
) -> None:
    channels = len(bias)
    embedded = np.empty(channels, np.float32)
    for i in range(len(cells)):
        embedded[:] = bias
        for d in range(described.shape[1]):
            value = described[i, d]
            for c in range(channels):
                embedded[c] += value * weight[d, c]
        row = image[cells[i]]
        for c in range(channels):
            row[c] = max(row[c], embedded[c])
