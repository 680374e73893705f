"""The part of the ground plane that an object stands on: its box, or the hull of a cluster."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.objects import Boxes, Objects, Tracks


def footprints(boxes: Boxes, margin_m: float, cell_m: float) -> tuple[F64, I64]:
    """Edges of N convex footprints, and where each one's begin (N + 1,).

    A row (7,) of the edges: outward normal (x, y) and offset, a point p is inside where
    `normal @ p <= offset` for all of its edges; then the footprint's bounds (low x, high x, low y,
    high y). Footprints grow by `margin_m`. A box thinner than a cell still owns the cells that its
    middle runs through; a hull grows by half a cell, since its corners are points, not cells. A
    hull may run either way round; one of fewer than three corners gives way to the box.
    """
    hull = boxes.hull if isinstance(boxes, Objects | Tracks) else None
    if hull is None:
        return _edges(_box_corners(boxes, margin_m, cell_m), np.arange(len(boxes) + 1) * 4, 0.0)
    if any(len(corners) < 3 for corners in hull):
        box = _box_corners(boxes, 0.0, 0.0).reshape(-1, 4, 2)
        hull = tuple(h if len(h) >= 3 else b for h, b in zip(hull, box, strict=True))
    start = np.concatenate([[0], np.cumsum([len(corners) for corners in hull])]).astype(np.int64)
    corners = np.concatenate(hull) if hull else np.zeros((0, 2))
    return _edges(corners, start, margin_m + cell_m / 2)


def _box_corners(boxes: Boxes, margin_m: float, cell_m: float) -> F64:
    """(4 N, 2) corners, counter-clockwise, box after box."""
    half_m = np.maximum(boxes.size_m[:, :2] / 2 + margin_m, cell_m / np.sqrt(2))
    along = half_m[:, :1] * np.array([1.0, -1.0, -1.0, 1.0])
    across = half_m[:, 1:] * np.array([1.0, 1.0, -1.0, -1.0])
    cos, sin = np.cos(boxes.yaw_rad)[:, None], np.sin(boxes.yaw_rad)[:, None]
    x = boxes.centre_m[:, :1] + along * cos - across * sin
    y = boxes.centre_m[:, 1:2] + along * sin + across * cos
    return np.stack([x, y], axis=2).reshape(-1, 2)


def _edges(corners: F64, start: I64, grow_m: float) -> tuple[F64, I64]:
    following = np.arange(1, len(corners) + 1)
    following[start[1:] - 1] = start[:-1]
    side = corners[following] - corners
    length = np.maximum(np.hypot(side[:, 0], side[:, 1]), 1e-12)
    normal = np.stack([side[:, 1], -side[:, 0]], axis=1) / length[:, None]
    owner = np.repeat(np.arange(len(start) - 1), np.diff(start))
    if len(corners):
        about = corners - corners[start[:-1]][owner]
        area = np.add.reduceat(about[:, 0] * side[:, 1] - about[:, 1] * side[:, 0], start[:-1])
        normal[(area < 0.0)[owner]] *= -1.0
    offset = np.einsum("ei,ei->e", normal, corners) + grow_m
    bounds = np.zeros((len(start) - 1, 4))
    if len(corners):
        for axis in (0, 1):
            bounds[:, 2 * axis] = np.minimum.reduceat(corners[:, axis], start[:-1]) - grow_m
            bounds[:, 2 * axis + 1] = np.maximum.reduceat(corners[:, axis], start[:-1]) + grow_m
    return np.column_stack([normal, offset, bounds[owner]]), start
