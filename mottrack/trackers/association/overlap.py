"""Overlap of candidate boxes as a cost."""

from collections.abc import Callable

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.geometry.iou import bev_iou, giou_3d, giou_bev, iou_3d
from mottrack.trackers.association.candidates import runs

OVERLAPS: dict[str, Callable[[F64, F64], F64]] = {
    "iou_bev": bev_iou,
    "iou_3d": iou_3d,
    "giou_bev": giou_bev,
    "giou_3d": giou_3d,
}


def overlap_cost(
    left: F64, right: F64, pairs: tuple[I64, I64], overlap: Callable[[F64, F64], F64]
) -> F64:
    """1 - overlap of each pair of boxes (N, 7) and (M, 7), rows of x, y, z, l, w, h, yaw; (P,).

    `overlap` is one of the all-pairs functions in OVERLAPS; it is asked for row by row, for the
    candidates alone.
    """
    cost = np.empty(len(pairs[0]))
    for start, stop in runs(pairs[0]):
        row = pairs[0][start]
        cost[start:stop] = 1.0 - overlap(left[row : row + 1], right[pairs[1][start:stop]])[0]
    return cost
