"""Convex hulls, smallest rectangles and centroids of many point groups in one compiled pass.

Needed for every sweep. With shapely (`benchmarks/polygons.py`, `benchmarks/clusters.py`) it would
take 1.5 to 4 times as long, one to two milliseconds more for a sweep of 100,000 points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.core.checks import require_all
from mottrack.geometry.polygon import convex_area, monotone_chain

_PAD_M = 0.05
"""Half width of the rectangle around points on a line: a post or a thin wall."""
_MIN_AREA_M2 = 1e-3
"""Thinner hulls are treated as lines: their area is range noise."""
_FILTERED = 16
"""With fewer points the octagon test costs more than sorting them."""


class HullSet(NamedTuple):
    """Convex hulls of G groups, their centroids and rectangles. Metres, frame of the points."""

    corner_m: F64
    """(sum K, 2) corners of all hulls, one hull after the other, counter-clockwise."""
    start: I64
    """(G + 1,) first corner of each hull."""
    centroid_m: F64
    """(G, 2) area centroid of each hull."""
    rectangle: F64
    """(G, 5) smallest enclosing rectangle: centre x, y, length >= width, heading of the length."""

    def polygons(self) -> tuple[F64, ...]:
        """Return the corners (K, 2) of each hull."""
        return tuple(np.split(self.corner_m, self.start[1:-1])) if len(self.start) > 1 else ()


def hulls_of_groups(xy_m: F64, start: I64) -> HullSet:
    """Compute hulls of points (N, 2) sorted by group; `xy_m[start[g]:start[g + 1]]` are group g's.

    A group on a line, or of one or two points, gets the rectangle around its points, padded by
    5 cm, so that every hull has an area.

    Raises:
        InputError: a group holds no point.
    """
    sizes = np.diff(start)
    require_all("points of group", sizes, sizes > 0, "at least one")
    corner_m, first = _hulls(xy_m, start)
    centroid_m, rectangle = _summaries(corner_m, first)
    return HullSet(corner_m, first, centroid_m, rectangle)


@compiled
def _hulls(xy_m: F64, start: I64) -> tuple[F64, I64]:
    groups = len(start) - 1
    first = np.zeros(groups + 1, np.int64)
    corner_m = np.empty((len(xy_m) + 4 * groups, 2))
    for g in range(groups):
        points = _outer_points(xy_m[start[g] : start[g + 1]])
        corners = np.empty((2 * len(points) + 1, 2))
        hull = corners[: monotone_chain(points, _by_x_then_y(points), corners)]
        if len(hull) < 3 or convex_area(hull, len(hull)) < _MIN_AREA_M2:
            hull = _padded_rectangle(points)
        first[g + 1] = first[g] + len(hull)
        for i in range(len(hull)):
            corner_m[first[g] + i, 0], corner_m[first[g] + i, 1] = hull[i, 0], hull[i, 1]
    return corner_m[: first[groups]].copy(), first


@compiled
def _outer_points(points: F64) -> F64:
    """Return the points not inside the octagon of extreme points (Akl and Toussaint, 1978)."""
    if len(points) < _FILTERED:
        return points.copy()
    octagon = _extreme_points(points)
    kept = np.empty_like(points)
    count = 0
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        if not _strictly_inside(octagon, x, y):
            kept[count, 0], kept[count, 1] = x, y
            count += 1
    return kept[:count]


@compiled
def _extreme_points(points: F64) -> F64:
    """Return (8, 2) the farthest point in each of eight directions, counter-clockwise."""
    best = np.full(8, -np.inf)
    which = np.zeros(8, np.int64)
    reach = np.empty(8)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        reach[0], reach[1], reach[2], reach[3] = x, x + y, y, y - x
        for k in range(4):
            reach[k + 4] = -reach[k]
        for k in range(8):
            if reach[k] > best[k]:
                best[k] = reach[k]
                which[k] = i
    return points[which]


@compiled
def _strictly_inside(polygon: F64, x: float, y: float) -> bool:
    for k in range(8):
        ax, ay = polygon[k - 1, 0], polygon[k - 1, 1]
        ex, ey = polygon[k, 0] - ax, polygon[k, 1] - ay
        if (ex != 0.0 or ey != 0.0) and ex * (y - ay) - ey * (x - ax) <= 0.0:
            return False
    return True


@compiled
def _by_x_then_y(points: F64) -> I64:
    """Return the order by x, ties by y: one fast sort, then insertions among the few ties."""
    order = np.argsort(points[:, 0])
    for i in range(1, len(order)):
        k = i
        while k > 0 and points[order[k - 1], 0] == points[order[k], 0]:
            if points[order[k - 1], 1] <= points[order[k], 1]:
                break
            order[k - 1], order[k] = order[k], order[k - 1]
            k -= 1
    return order


@compiled
def _cross(a: F64, b: F64, c: F64) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


@compiled
def _padded_rectangle(points: F64) -> F64:
    """Return the corners of a rectangle along the line of the points, padded on all sides."""
    low, high = points[0], points[0]
    for i in range(1, len(points)):
        x, y = points[i]
        if x < low[0] or (x == low[0] and y < low[1]):
            low = points[i]
        if x > high[0] or (x == high[0] and y > high[1]):
            high = points[i]
    reach = np.hypot(high[0] - low[0], high[1] - low[1])
    ux, uy = 1.0, 0.0
    if reach > 0.0:
        ux, uy = (high[0] - low[0]) / reach, (high[1] - low[1]) / reach
    along, across = 0.5 * reach + _PAD_M, _PAD_M
    cx, cy = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
    corners = np.empty((4, 2))
    for k in range(4):
        a = along if k in (1, 2) else -along
        b = across if k >= 2 else -across
        corners[k, 0] = cx + a * ux - b * uy
        corners[k, 1] = cy + a * uy + b * ux
    return corners


@compiled
def _summaries(corner_m: F64, start: I64) -> tuple[F64, F64]:
    groups = len(start) - 1
    centroid_m, rectangle = np.empty((groups, 2)), np.empty((groups, 5))
    for g in range(groups):
        hull = corner_m[start[g] : start[g + 1]]
        centroid_m[g] = _centroid(hull)
        rectangle[g] = _smallest_rectangle(hull)
    return centroid_m, rectangle


@compiled
def _centroid(hull: F64) -> F64:
    total, x, y = 0.0, 0.0, 0.0
    for k in range(1, len(hull) - 1):
        area = _cross(hull[0], hull[k], hull[k + 1])
        total += area
        x += area * (hull[k, 0] + hull[k + 1, 0] - 2 * hull[0, 0]) / 3.0
        y += area * (hull[k, 1] + hull[k + 1, 1] - 2 * hull[0, 1]) / 3.0
    return np.array([hull[0, 0] + x / total, hull[0, 1] + y / total])


@compiled
def _smallest_rectangle(hull: F64) -> F64:
    """Return centre, length, width, heading of the smallest rectangle; it shares an edge's line."""
    best = np.empty(5)
    smallest = np.inf
    for k in range(len(hull)):
        ex, ey = hull[k, 0] - hull[k - 1, 0], hull[k, 1] - hull[k - 1, 1]
        norm = np.hypot(ex, ey)
        if norm == 0.0:
            continue
        ux, uy = ex / norm, ey / norm
        along, across = _span(hull, ux, uy), _span(hull, -uy, ux)
        length, width = along[1] - along[0], across[1] - across[0]
        if length * width < smallest:
            smallest = length * width
            a, b = 0.5 * (along[0] + along[1]), 0.5 * (across[0] + across[1])
            best[0], best[1] = a * ux - b * uy, a * uy + b * ux
            heading = np.arctan2(uy, ux)
            if length >= width:
                best[2], best[3], best[4] = length, width, heading
            else:
                best[2], best[3], best[4] = width, length, heading + 0.5 * np.pi
    return best


@compiled
def _span(hull: F64, ux: float, uy: float) -> tuple[float, float]:
    low, high = np.inf, -np.inf
    for i in range(len(hull)):
        reach = hull[i, 0] * ux + hull[i, 1] * uy
        low, high = min(low, reach), max(high, reach)
    return low, high
