"""Costs of candidate pairs: one number per pair, lower is better."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.geometry.iou import bev_iou, giou_3d, giou_bev, iou_3d

OVERLAPS: dict[str, Callable[[F64, F64], F64]] = {
    "iou_bev": bev_iou,
    "iou_3d": iou_3d,
    "giou_bev": giou_bev,
    "giou_3d": giou_3d,
}


def centre_distance_m(left_xy_m: F64, right_xy_m: F64, pairs: tuple[I64, I64]) -> F64:
    """Return the distance (P,) in metres between the centres (N, 2) and (M, 2) of each pair."""
    return np.asarray(np.linalg.norm(left_xy_m[pairs[0]] - right_xy_m[pairs[1]], axis=1))


def overlap_cost(left: F64, right: F64, pairs: tuple[I64, I64], overlap: str) -> F64:
    """Return 1 - overlap (P,) of each pair of boxes (N, 7) and (M, 7), rows x, y, z, l, w, h, yaw.

    `overlap` names one of OVERLAPS. These compute all pairs of two sets, so they are called for
    one row of `left` at a time, with its candidates alone. `pairs` are sorted by their first index.
    """
    rows, first = np.unique(pairs[0], return_index=True)
    bounds = [*first.tolist(), len(pairs[0])]
    cost = np.empty(len(pairs[0]))
    for row, start, stop in zip(rows.tolist(), bounds, bounds[1:], strict=False):
        candidates = right[pairs[1][start:stop]]
        cost[start:stop] = 1.0 - OVERLAPS[overlap](left[row : row + 1], candidates)[0]
    return cost
