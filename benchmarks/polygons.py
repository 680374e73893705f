"""Convex polygons: the compiled geometry of the trackers beside shapely.

Three jobs of `mottrack.trackers.fixed_lag.merge_split` and of the matching of clusters with boxes:
all overlaps of two sets of hulls (once or twice per frame), joining the pieces of a split object
(rarely), and one hull against one box. CPU time per call on one core; shapely's includes making its
polygons from corner arrays, since hulls move in every frame. "difference" is that of the total
areas in square metres.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely
from _common import arguments, report

from mottrack.geometry.hulls import hulls_of_groups
from mottrack.geometry.polygon import intersection_area, polygon_area
from mottrack.trackers.fixed_lag.merge_split import HullList, flat, overlaps

CORNERS = 8
SPACING_M = 5.0


def hulls(count: int, seed: int) -> list[np.ndarray]:
    """Convex hulls of random points on objects of 4 m by 2 m at a constant density."""
    rng = np.random.default_rng(seed)
    side = SPACING_M * np.sqrt(count)
    places = np.random.default_rng(0).uniform(0.0, side, (count, 2))
    points = rng.uniform([-2.0, -1.0], [2.0, 1.0], (count, 3 * CORNERS, 2))
    angle = rng.uniform(-np.pi, np.pi, count)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = np.einsum("ijn,nkj->nki", turn, points) + places[:, None]
    starts = np.arange(count + 1) * 3 * CORNERS
    return list(hulls_of_groups(moved.reshape(-1, 2), starts).polygons())


def shapely_overlaps(one: HullList, other: HullList) -> float:
    """Total shared area, by a tree of bounds and shapely's intersection."""
    a = [shapely.Polygon(corners) for corners in one.polygons()]
    b = [shapely.Polygon(corners) for corners in other.polygons()]
    i, j = shapely.STRtree(b).query(a, predicate="intersects")
    shared = shapely.intersection(np.array(a)[i], np.array(b)[j])
    return float(shapely.area(shared).sum())


def shapely_join(pieces: list[np.ndarray]) -> float:
    """Area of the common hull, whose smallest rectangle is computed too."""
    hull = shapely.convex_hull(shapely.MultiPoint(np.concatenate(pieces)))
    shapely.minimum_rotated_rectangle(hull)
    return float(hull.area)


def compiled_join(pieces: list[np.ndarray]) -> float:
    corners = np.concatenate(pieces)
    return polygon_area(hulls_of_groups(corners, np.array([0, len(corners)])).corner_m)


def best_ms(work: Callable[[], object], repeats: int) -> float:
    work()
    times = []
    for _ in range(repeats):
        start = time.process_time_ns()
        work()
        times.append((time.process_time_ns() - start) * 1e-6)
    return float(np.median(times))


def row(
    what: str, repeats: int, compiled: Callable[[], float], peer: Callable[[], float]
) -> dict[str, Any]:
    ours_ms, shapely_ms = best_ms(compiled, repeats), best_ms(peer, repeats)
    return {
        "what": what,
        "compiled_ms": ours_ms,
        "shapely_ms": shapely_ms,
        "shapely_over_this": shapely_ms / ours_ms,
        "difference": abs(compiled() - peer()),
    }


def main() -> None:
    options = arguments(__doc__ or "")
    repeats = 11 if options.quick else 101
    rows = []
    for count in (60, 300) if options.quick else (60, 300, 1000):
        one, other = flat(hulls(count, 1)), flat(hulls(count, 2))
        rows.append(
            row(
                f"overlaps of {count} and {count} hulls",
                repeats,
                lambda one=one, other=other: float(overlaps(one, other).area_m2.sum()),
                lambda one=one, other=other: shapely_overlaps(one, other),
            )
        )
    a, b = hulls(2, 1)
    box = np.array([[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]]) + a.mean(axis=0)
    rows.append(
        row(
            "join two pieces",
            repeats,
            lambda: compiled_join([a, b]),
            lambda: shapely_join([a, b]),
        )
    )
    rows.append(
        row(
            "hull against box",
            repeats,
            lambda: intersection_area(a, box),
            lambda: float(shapely.Polygon(a).intersection(shapely.Polygon(box)).area),
        )
    )
    report(rows, options.json)


if __name__ == "__main__":
    main()
