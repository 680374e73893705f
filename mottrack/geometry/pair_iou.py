"""Overlap of listed pairs of rotated boxes, where looking at all pairs would be a waste."""

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.geometry.polygon import clip_area


@compiled
def bev_iou_of_pairs(a: F64, b: F64, pairs: tuple[I64, I64]) -> F64:
    """Intersection over union from above of the pairs (i, j) of a (N, 7) and b (M, 7), (P,).

    Boxes are rows (x, y, z, l, w, h, yaw), as in `mottrack.geometry.iou`. Pairs whose circumscribed
    circles are apart are 0 without a look at their corners.
    """
    ratio = np.zeros(len(pairs[0]))
    work = np.empty((2, 9, 2))
    one, other = np.empty((4, 2)), np.empty((4, 2))
    for p in range(len(ratio)):
        i, j = a[pairs[0][p]], b[pairs[1][p]]
        x, y = j[0] - i[0], j[1] - i[1]
        reach = 0.5 * (np.hypot(i[3], i[4]) + np.hypot(j[3], j[4]))
        if x * x + y * y < reach * reach:
            _corners(i, 0.0, 0.0, one)
            _corners(j, x, y, other)
            shared = clip_area(one, other, work)
            ratio[p] = shared / (i[3] * i[4] + j[3] * j[4] - shared)
    return ratio


@compiled
def _corners(box: F64, x: float, y: float, out: F64) -> None:
    """Corners (4, 2) of a box that is moved to (x, y), counter-clockwise."""
    cos, sin = np.cos(box[6]), np.sin(box[6])
    for k in range(4):
        along = 0.5 * box[3] if k in (0, 3) else -0.5 * box[3]
        across = 0.5 * box[4] if k < 2 else -0.5 * box[4]
        out[k, 0] = x + cos * along - sin * across
        out[k, 1] = y + sin * along + cos * across
