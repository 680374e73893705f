"""Warping: what the previous sweep shows where a cell came from."""

from __future__ import annotations

import torch
from torch.nn import functional


def warp(features: torch.Tensor, motion_cells: torch.Tensor) -> torch.Tensor:
    """Sample the previous `features` (B,C,H,W) at each cell's place minus its motion.

    `motion_cells` (B,2,H,W) is (x, y) = (columns, rows) travelled between the sweeps, so the
    source of cell p is p - m(p). Bilinear, zeros outside of the grid.
    """
    height, width = features.shape[-2:]
    rows = torch.arange(height, device=features.device, dtype=motion_cells.dtype)
    columns = torch.arange(width, device=features.device, dtype=motion_cells.dtype)
    x = (columns[None, None, :] - motion_cells[:, 0] + 0.5) * (2.0 / width) - 1.0
    y = (rows[None, :, None] - motion_cells[:, 1] + 0.5) * (2.0 / height) - 1.0
    places = torch.stack((x, y), dim=-1)
    return functional.grid_sample(
        features,
        places.to(features.dtype),
        mode="bilinear",
        padding_mode="zeros",
        align_corners=False,
    )
