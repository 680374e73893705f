"""Overlap of axis-aligned rectangles: rows (N, 4) of left, top, right, bottom, in pixels."""

import numpy as np

from mottrack.core.arrays import F64


def rectangle_iou(a: F64, b: F64) -> F64:
    """Return (N, M) IoU of all pairs of a (N, 4) and b (M, 4); 0 without area."""
    shared = shared_area(a, b)
    union = rectangle_area(a)[:, None] + rectangle_area(b)[None, :] - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)


def shared_area(a: F64, b: F64) -> F64:
    """Return (N, M) the area that each of a (N, 4) shares with each of b (M, 4)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    area: F64 = np.prod(np.maximum(high - low, 0.0), axis=2)
    return area


def rectangle_area(boxes: F64) -> F64:
    """Return (N,) areas of rectangles (N, 4); negative where right is left of left."""
    return (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
