"""Overlap of listed pairs of rotated boxes, where looking at all pairs would be a waste."""

import numba
import numpy as np
from numpy.typing import NDArray

from mottrack.geometry.iou import bev_corners
from mottrack.geometry.polygon import clip_area

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


def bev_iou_of_pairs(a: F64, b: F64, pairs: tuple[I64, I64]) -> F64:
    """Intersection over union from above of the pairs (i, j) of a (N, 7) and b (M, 7), (P,).

    Boxes are rows (x, y, z, l, w, h, yaw), as in `mottrack.geometry.iou`.
    """
    i, j = pairs
    if len(i) == 0:
        return np.empty(0)
    about_a, about_b = a.copy(), b.copy()
    about_a[:, :2] = about_b[:, :2] = 0.0
    offset = b[j, :2] - a[i, :2]
    shared: F64 = _shared_areas(bev_corners(about_a)[i], bev_corners(about_b)[j], offset)
    union = a[i, 3] * a[i, 4] + b[j, 3] * b[j, 4] - shared
    ratio: F64 = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0.0)
    return ratio


@numba.njit(cache=True)
def _shared_areas(a: F64, b: F64, offset: F64) -> F64:
    areas = np.zeros(len(a))
    work = np.empty((2, 9, 2))
    moved = np.empty((4, 2))
    for p in range(len(a)):
        for k in range(4):
            moved[k, 0] = b[p, k, 0] + offset[p, 0]
            moved[k, 1] = b[p, k, 1] + offset[p, 1]
        areas[p] = clip_area(a[p], moved, work)
    return areas
