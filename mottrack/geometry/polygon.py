"""Convex polygons in the plane: area, clipping and hull, compiled.

Beside shapely's vectorised functions (`benchmarks/polygons.py`) suppression over listed pairs
is 260 times as fast, and hulls four times; where single polygons are compared, use shapely.
"""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64


@compiled
def clip_area(subject: F64, clip: F64, work: F64) -> float:
    """Return the area of the intersection of two convex, counter-clockwise polygons.

    Sutherland and Hodgman's clipping, one edge of `clip` after the other. `subject` (K, 2) and
    `clip` (L, 2) in the same unit; `work` (2, K + L + 1, 2) is scratch. 0 where they only touch.
    """
    count = subject.shape[0]
    for i in range(count):
        work[0, i, 0] = subject[i, 0]
        work[0, i, 1] = subject[i, 1]
    now = 0
    for e in range(clip.shape[0]):
        x0, y0 = clip[e - 1, 0], clip[e - 1, 1]
        dx, dy = clip[e, 0] - x0, clip[e, 1] - y0
        kept = 0
        for i in range(count):
            ax, ay = work[now, i - 1 if i > 0 else count - 1]
            bx, by = work[now, i]
            a_side = dx * (ay - y0) - dy * (ax - x0)
            b_side = dx * (by - y0) - dy * (bx - x0)
            if (a_side < 0.0) != (b_side < 0.0):
                share = a_side / (a_side - b_side)
                work[1 - now, kept, 0] = ax + share * (bx - ax)
                work[1 - now, kept, 1] = ay + share * (by - ay)
                kept += 1
            if b_side >= 0.0:
                work[1 - now, kept, 0] = bx
                work[1 - now, kept, 1] = by
                kept += 1
        now = 1 - now
        count = kept
        if count < 3:
            return 0.0
    return convex_area(work[now], count)


@compiled
def convex_area(points: F64, count: int) -> float:
    """Return the area of the counter-clockwise polygon of the first `count` rows of `points`."""
    twice = 0.0
    for i in range(1, count - 1):
        ax, ay = points[i, 0] - points[0, 0], points[i, 1] - points[0, 1]
        bx, by = points[i + 1, 0] - points[0, 0], points[i + 1, 1] - points[0, 1]
        twice += ax * by - ay * bx
    return max(0.5 * twice, 0.0)


@compiled
def monotone_chain(points: F64, order: I64, hull: F64) -> int:
    """Fill `hull` with the convex hull of points (N, 2); return its number of corners.

    Andrew's monotone chain: counter-clockwise, no corner on a straight edge. `order` (N,) sorts
    the points by x, ties by y; `hull` (2 N + 1, 2) is also scratch.
    """
    size = 0
    for backwards in range(2):
        base = size
        for i in range(len(order)):
            chosen = order[len(order) - 1 - i if backwards else i]
            x, y = points[chosen, 0], points[chosen, 1]
            while size >= base + 2:
                ax, ay = hull[size - 2, 0], hull[size - 2, 1]
                if (hull[size - 1, 0] - ax) * (y - ay) > (hull[size - 1, 1] - ay) * (x - ax):
                    break
                size -= 1
            hull[size, 0], hull[size, 1] = x, y
            size += 1
        size -= 1
    return size


def polygon_area(points: F64) -> float:
    """Return the signed area of a polygon (K, 2); positive when counter-clockwise."""
    x, y = points[:, 0] - points[0, 0], points[:, 1] - points[0, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
