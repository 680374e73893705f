"""Dynamic pillars in one pass over the points: describe, embed, maximum, scatter (III-A)."""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I64
from mottrack.flow.pillarflow.descriptors import CellGrid, describe, place


def pillar_image(points: F32, grid: CellGrid, weight: F32, bias: F32) -> F32:
    """Pseudo-image (rows,columns,C) of points (N,4) by the folded layer: (C,9) and (C,)."""
    described, cells, _ = describe(points, grid)
    image = np.zeros((grid.cells, len(bias)), np.float32)
    _embed(described, cells, np.ascontiguousarray(weight.T), bias, image)
    return image.reshape(grid.rows, grid.columns, len(bias))


def binary_image(points: F32, grid: CellGrid) -> F32:
    """Occupancy (rows,columns,1) as 0 and 1."""
    cells = place(points, grid)
    image = np.zeros((grid.cells, 1), np.float32)
    image[cells[cells >= 0]] = 1.0
    return image.reshape(grid.rows, grid.columns, 1)


@compiled(nogil=True, fastmath=True)
def _embed(described: F32, cells: I64, weight: F32, bias: F32, image: F32) -> None:
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
