"""Overlap of rotated boxes: BeV and 3-D IoU and GIoU, all pairs of two sets.

A box is a row (x, y, z, l, w, h, yaw): centre and extents in metres, heading in radians about +z,
both sets in one frame. Every function raises InputError for other shapes, for numbers that are not
finite and for negative extents.
"""

import numpy as np
from numpy.typing import ArrayLike

from mottrack.compiled import compiled
from mottrack.core.arrays import F64
from mottrack.core.checks import require_all, require_finite
from mottrack.core.errors import InputError
from mottrack.geometry.polygon import clip_area, shoelace


def boxes7(centre_m: F64, size_m: F64, yaw_rad: F64) -> F64:
    """Rows (x, y, z, l, w, h, yaw) of boxes given as (N, 3), (N, 3) l w h and (N,)."""
    return np.concatenate([centre_m, size_m, np.asarray(yaw_rad)[:, None]], axis=1)


def bev_corners(boxes: ArrayLike) -> F64:
    """Corners of the boxes (N, 7) in the ground plane, (N, 4, 2) metres, counter-clockwise."""
    b = _checked(boxes, "boxes")
    along = np.array([0.5, -0.5, -0.5, 0.5]) * b[:, 3, None]
    across = np.array([0.5, 0.5, -0.5, -0.5]) * b[:, 4, None]
    cos, sin = np.cos(b[:, 6, None]), np.sin(b[:, 6, None])
    x = b[:, 0, None] + cos * along - sin * across
    y = b[:, 1, None] + sin * along + cos * across
    return np.stack([x, y], axis=2)


def bev_intersection(a: ArrayLike, b: ArrayLike) -> F64:
    """Area in square metres that each box of a (N, 7) shares with each of b (M, 7), from above.

    Pairs whose circumscribed circles are apart are 0 without a look at their corners.
    """
    rows, columns = _checked(a, "a"), _checked(b, "b")
    area: F64 = _intersections(rows, _relative_corners(rows), columns, _relative_corners(columns))
    return area


def bev_iou(a: ArrayLike, b: ArrayLike) -> F64:
    """Intersection over union from above of all pairs, (N, M) in [0, 1]."""
    rows, columns = _checked(a, "a"), _checked(b, "b")
    shared = bev_intersection(rows, columns)
    return _ratio(shared, _area(rows)[:, None] + _area(columns)[None, :] - shared)


def iou_3d(a: ArrayLike, b: ArrayLike) -> F64:
    """Intersection over union of the volumes of all pairs, (N, M) in [0, 1]."""
    rows, columns = _checked(a, "a"), _checked(b, "b")
    shared = bev_intersection(rows, columns) * _height_overlap(rows, columns)
    volume_a, volume_b = _area(rows) * rows[:, 5], _area(columns) * columns[:, 5]
    return _ratio(shared, volume_a[:, None] + volume_b[None, :] - shared)


def giou_bev(a: ArrayLike, b: ArrayLike) -> F64:
    """Generalised IoU from above of all pairs, (N, M) in (-1, 1].

    GIoU = IoU - (C - U) / C, U the union and C the convex hull of both (Rezatofighi et al., 2019).
    """
    rows, columns = _checked(a, "a"), _checked(b, "b")
    shared = bev_intersection(rows, columns)
    union = _area(rows)[:, None] + _area(columns)[None, :] - shared
    hull = np.maximum(_hulls_of(rows, columns), union)
    return _ratio(shared, union) - _ratio(hull - union, hull)


def giou_3d(a: ArrayLike, b: ArrayLike) -> F64:
    """Generalised IoU of volumes of all pairs, (N, M) in (-1, 1].

    The enclosing body is the convex hull from above times the height from the lowest to the highest
    face, as usual for boxes that turn about the vertical only.
    """
    rows, columns = _checked(a, "a"), _checked(b, "b")
    shared = bev_intersection(rows, columns) * _height_overlap(rows, columns)
    volume_a, volume_b = _area(rows) * rows[:, 5], _area(columns) * columns[:, 5]
    union = volume_a[:, None] + volume_b[None, :] - shared
    body = np.maximum(_hulls_of(rows, columns) * _height_span(rows, columns), union)
    return _ratio(shared, union) - _ratio(body - union, body)


def _checked(boxes: ArrayLike, name: str) -> F64:
    array = np.ascontiguousarray(boxes, np.float64)
    if array.size == 0:
        return array.reshape(0, 7)
    if array.ndim != 2 or array.shape[1] != 7:
        expected = "(N, 7) rows of x, y, z, l, w, h, yaw"
        raise InputError(f"shape of {name}", array.shape, expected)
    require_finite(name, array)
    require_all(f"extent of {name}", array[:, 3:6], array[:, 3:6] >= 0.0, "at least 0 m")
    return array


def _relative_corners(boxes: F64) -> F64:
    """Corners about each box's own centre, so that far coordinates cost no precision."""
    about_centre = boxes.copy()
    about_centre[:, :2] = 0.0
    return bev_corners(about_centre)


def _area(boxes: F64) -> F64:
    return boxes[:, 3] * boxes[:, 4]


def _ratio(part: F64, whole: F64) -> F64:
    """Part over whole, 0 where the whole is nothing."""
    share: F64 = np.divide(part, whole, out=np.zeros_like(part), where=whole > 0.0)
    return share


def _height_overlap(a: F64, b: F64) -> F64:
    top = np.minimum((a[:, 2] + a[:, 5] / 2)[:, None], (b[:, 2] + b[:, 5] / 2)[None, :])
    bottom = np.maximum((a[:, 2] - a[:, 5] / 2)[:, None], (b[:, 2] - b[:, 5] / 2)[None, :])
    overlap: F64 = np.maximum(top - bottom, 0.0)
    return overlap


def _height_span(a: F64, b: F64) -> F64:
    top = np.maximum((a[:, 2] + a[:, 5] / 2)[:, None], (b[:, 2] + b[:, 5] / 2)[None, :])
    bottom = np.minimum((a[:, 2] - a[:, 5] / 2)[:, None], (b[:, 2] - b[:, 5] / 2)[None, :])
    return top - bottom


def _hulls_of(a: F64, b: F64) -> F64:
    areas: F64 = _hulls(a, _relative_corners(a), b, _relative_corners(b))
    return areas


@compiled
def _intersections(a: F64, a_corners: F64, b: F64, b_corners: F64) -> F64:
    areas = np.zeros((a.shape[0], b.shape[0]))
    work = np.empty((2, 9, 2))
    moved = np.empty((4, 2))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            dx, dy = b[j, 0] - a[i, 0], b[j, 1] - a[i, 1]
            reach = 0.5 * (np.hypot(a[i, 3], a[i, 4]) + np.hypot(b[j, 3], b[j, 4]))
            if dx * dx + dy * dy > reach * reach:
                continue
            for k in range(4):
                moved[k, 0] = b_corners[j, k, 0] + dx
                moved[k, 1] = b_corners[j, k, 1] + dy
            areas[i, j] = clip_area(a_corners[i], moved, work)
    return areas


@compiled
def _hulls(a: F64, a_corners: F64, b: F64, b_corners: F64) -> F64:
    areas = np.zeros((a.shape[0], b.shape[0]))
    points = np.empty((8, 2))
    hull = np.empty((17, 2))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            for k in range(4):
                points[k] = a_corners[i, k]
                points[4 + k, 0] = b_corners[j, k, 0] + (b[j, 0] - a[i, 0])
                points[4 + k, 1] = b_corners[j, k, 1] + (b[j, 1] - a[i, 1])
            areas[i, j] = shoelace(hull, _convex_hull(points, hull))
    return areas


@compiled
def _convex_hull(points: F64, hull: F64) -> int:
    """Andrew's monotone chain; sorts `points` in place, fills `hull`, returns its length."""
    count = points.shape[0]
    for i in range(1, count):
        x, y = points[i]
        j = i
        while j > 0 and (points[j - 1, 0] > x or (points[j - 1, 0] == x and points[j - 1, 1] > y)):
            points[j] = points[j - 1]
            j -= 1
        points[j, 0], points[j, 1] = x, y
    size = 0
    for sweep in range(2):
        start = size
        for i in range(count):
            x, y = points[i if sweep == 0 else count - 1 - i]
            while size >= start + 2 and _turn(hull[size - 2], hull[size - 1], x, y) <= 0.0:
                size -= 1
            hull[size, 0], hull[size, 1] = x, y
            size += 1
        size -= 1
    return size


@compiled
def _turn(a: F64, b: F64, x: float, y: float) -> float:
    return float((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]))
