"""Targets: the motion of each occupied cell, from the motion of its points (III-C)."""

from __future__ import annotations

import numpy as np
import torch
from torch.nn import functional

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I64


def cell_means(values: F32, cells: I64, count: int) -> tuple[F32, F32]:
    """Mean of `values` (N,K) over the points of each cell (count,K), and their number (count,)."""
    means: tuple[F32, F32] = _cell_means(values, cells, count)
    return means


@compiled(nogil=True)
def _cell_means(values: F32, cells: I64, count: int) -> tuple[F32, F32]:
    sums = np.zeros((count, values.shape[1]), np.float32)
    points = np.zeros(count, np.float32)
    for i in range(len(cells)):
        points[cells[i]] += 1.0
        for k in range(values.shape[1]):
            sums[cells[i], k] += values[i, k]
    for cell in range(count):
        if points[cell] > 0.0:
            for k in range(values.shape[1]):
                sums[cell, k] /= points[cell]
    return sums, points


def pooled_target(
    motion_m: torch.Tensor, mask: torch.Tensor, stride: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Average a target (B,2,H,W) over the cells of `mask` (B,1,H,W) in blocks of `stride`.

    Returns the pooled motion and the mask of blocks that hold at least one cell.
    """
    if stride == 1:
        return motion_m, mask > 0
    share = functional.avg_pool2d(mask, stride)
    total = functional.avg_pool2d(motion_m * mask, stride)
    return total / share.clamp(min=1e-6), share > 0
