"""Convex polygons in the plane: clipping and area, compiled."""

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64


@compiled
def clip_area(subject: F64, clip: F64, work: F64) -> float:
    """Area of the intersection of two convex, counter-clockwise polygons.

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
    return float(shoelace(work[now], count))


@compiled
def shoelace(points: F64, count: int) -> float:
    """Area of the counter-clockwise polygon made of the first `count` rows of `points`."""
    twice = 0.0
    for i in range(1, count - 1):
        ax, ay = points[i, 0] - points[0, 0], points[i, 1] - points[0, 1]
        bx, by = points[i + 1, 0] - points[0, 0], points[i + 1, 1] - points[0, 1]
        twice += ax * by - ay * bx
    return max(0.5 * twice, 0.0)


def polygon_area(points: F64) -> float:
    """Signed area of a polygon (K, 2); positive when counter-clockwise."""
    x, y = points[:, 0] - points[0, 0], points[:, 1] - points[0, 1]
    following = np.arange(1 - len(points), 1)
    return 0.5 * float(np.sum(x * y[following] - y * x[following]))


def counter_clockwise(points: F64) -> F64:
    """The polygon (K, 2), its order reversed if it ran clockwise."""
    ordered = points if polygon_area(points) >= 0.0 else points[::-1]
    return np.ascontiguousarray(ordered, np.float64)


def intersection_area(a: F64, b: F64) -> float:
    """Area shared by two convex polygons (K, 2) and (L, 2), of either orientation; unit squared.

    A polygon of fewer than three corners has no area.
    """
    if len(a) < 3 or len(b) < 3:
        return 0.0
    origin = a.mean(axis=0)
    subject, clip = counter_clockwise(a - origin), counter_clockwise(b - origin)
    return float(clip_area(subject, clip, np.empty((2, len(a) + len(b) + 1, 2))))
