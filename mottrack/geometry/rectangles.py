"""Overlap of axis-aligned rectangles: rows (N, 4) of left, top, right, bottom, in pixels."""

import numpy as np

from mottrack.core.arrays import F64


def rectangle_iou(a: F64, b: F64) -> F64:
    """Return (N, M) IoU of all pairs of a (N, 4) and b (M, 4); 0 without area."""
    return rectangle_iou_of_pairs(a[:, None], b[None, :])


def rectangle_iou_of_pairs(a: F64, b: F64) -> F64:
    """Return (...) IoU of each of a (..., 4) with its partner in b (..., 4)."""
    shared = _shared(a, b)
    union = rectangle_area(a) + rectangle_area(b) - shared
    iou: F64 = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return iou


def shared_area(a: F64, b: F64) -> F64:
    """Return (N, M) the area that each of a (N, 4) shares with each of b (M, 4)."""
    return _shared(a[:, None], b[None, :])


def _shared(a: F64, b: F64) -> F64:
    width = np.minimum(a[..., 2], b[..., 2]) - np.maximum(a[..., 0], b[..., 0])
    height = np.minimum(a[..., 3], b[..., 3]) - np.maximum(a[..., 1], b[..., 1])
    area: F64 = np.maximum(width, 0.0) * np.maximum(height, 0.0)
    return area


def rectangle_area(boxes: F64) -> F64:
    """Return (...) areas of rectangles (..., 4); negative where right is left of left."""
    area: F64 = (boxes[..., 2] - boxes[..., 0]) * (boxes[..., 3] - boxes[..., 1])
    return area
