"""Convex polygons: the compiled code of `mottrack.geometry` beside shapely's vectorised functions.

    python benchmarks/polygons.py [--json FILE] [--quick]

Every row is one call as it is made in use: overlap of two sets of hulls and the joining of two
pieces (merge and split of the fixed-lag tracker), hulls and their smallest rectangles of the
clusters of a sweep, overlap of all pairs of a frame's boxes (association) and of the listed pairs
of close boxes (non-maximum suppression). The results are compared first, and the script ends with
an error where they differ. CPU milliseconds on one core, minimum of the repetitions; the conversion
to shapely's geometries is part of its time. Where shapely was measured to be fast enough (the
overlap of single hulls with a few boxes, in the evaluation), it is used and has no row here.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely
from _common import arguments, report
from numpy.typing import NDArray

from mottrack.geometry.hulls import hulls_of_groups
from mottrack.geometry.iou import bev_corners, bev_iou, giou_bev, uncovered
from mottrack.geometry.rectangles import rectangle_iou
from mottrack.trackers.fixed_lag.merge_split import HullList, flat, overlaps

Array = NDArray[Any]

SUPPRESSED = 0.1
"""IoU with a better box above which the default preset drops one."""


def boxes(count: int, seed: int, half_m: float = 50.0) -> Array:
    """Rows (x, y, z, l, w, h, yaw) of vehicles spread over a square."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-half_m, half_m, (count, 2))
    size = rng.uniform(0.5, 5.0, (count, 3))
    return np.column_stack([centre, np.zeros(count), size, rng.uniform(-4, 4, count)])


def groups(clusters: int, points: int, seed: int = 0) -> tuple[Array, Array]:
    """Points (N, 2) sorted by cluster and the first one of each: few large, many small."""
    rng = np.random.default_rng(seed)
    sizes = np.maximum(rng.pareto(1.2, clusters) + 1, 1)
    sizes = np.maximum((sizes / sizes.sum() * points).astype(int), 4)
    start = np.concatenate([[0], np.cumsum(sizes)])
    centre = np.repeat(rng.uniform(-50, 50, (clusters, 2)), sizes, axis=0)
    return centre + rng.normal(0, 0.8, (start[-1], 2)), start


def hulls_by_shapely(xy_m: Array, start: Array) -> tuple[Array, Array, Array]:
    """Hull, centroid and smallest rectangle of each group."""
    owner = np.repeat(np.arange(len(start) - 1), np.diff(start))
    hull = shapely.convex_hull(shapely.linestrings(xy_m, indices=owner))
    centroid = shapely.get_coordinates(shapely.centroid(hull))
    return hull, centroid, shapely.minimum_rotated_rectangle(hull)


def check_hulls(compiled: Any, theirs: tuple[Array, Array, Array]) -> None:
    hull, centroid, rectangle = theirs
    area = shapely.area([shapely.Polygon(polygon) for polygon in compiled.polygons()])
    np.testing.assert_allclose(area, shapely.area(hull), rtol=1e-9)
    np.testing.assert_allclose(compiled.centroid_m, centroid, atol=1e-9)
    smallest = compiled.rectangle[:, 2] * compiled.rectangle[:, 3]
    np.testing.assert_allclose(smallest, shapely.area(rectangle), rtol=1e-6)


def iou_by_shapely(a: Array, b: Array) -> Array:
    """All pairs: a tree lists those whose bounds meet."""
    shape_a, shape_b = shapely.polygons(bev_corners(a)), shapely.polygons(bev_corners(b))
    i, j = shapely.STRtree(shape_b).query(shape_a)
    ratio = np.zeros((len(a), len(b)))
    ratio[i, j] = pair_ratio(shape_a[i], shape_b[j])
    return ratio


def pair_ratio(a: Array, b: Array) -> Array:
    shared = shapely.area(shapely.intersection(a, b))
    return shared / (shapely.area(a) + shapely.area(b) - shared)


def giou_by_shapely(a: Array, b: Array) -> Array:
    corners_a, corners_b = bev_corners(a), bev_corners(b)
    shape_a, shape_b = shapely.polygons(corners_a)[:, None], shapely.polygons(corners_b)[None]
    shared = shapely.area(shapely.intersection(shape_a, shape_b))
    union = shapely.area(shape_a) + shapely.area(shape_b) - shared
    both = [np.broadcast_to(corners_a[:, None], (len(a), len(b), 4, 2))]
    both.append(np.broadcast_to(corners_b[None], (len(a), len(b), 4, 2)))
    hull = shapely.area(shapely.convex_hull(shapely.linestrings(np.concatenate(both, axis=2))))
    return shared / union - (hull - union) / hull


def uncovered_by_shapely(a: Array, pairs: tuple[Array, Array], most: float) -> Array:
    shape = shapely.polygons(bev_corners(a))
    covered = pair_ratio(shape[pairs[0]], shape[pairs[1]]) > most
    kept = np.ones(len(a), np.bool_)
    for i, j in zip(pairs[0][covered].tolist(), pairs[1][covered].tolist(), strict=True):
        kept[j] &= not kept[i]
    return kept


def upright_by_shapely(a: Array, b: Array) -> Array:
    shape_a, shape_b = shapely.box(*a.T), shapely.box(*b.T)
    i, j = shapely.STRtree(shape_b).query(shape_a)
    ratio = np.zeros((len(a), len(b)))
    ratio[i, j] = pair_ratio(shape_a[i], shape_b[j])
    return ratio


def hulls(count: int, seed: int) -> HullList:
    """Hulls of 24 points each on objects of 4 m by 2 m, at a constant density."""
    rng = np.random.default_rng(seed)
    places = np.random.default_rng(0).uniform(0.0, 5.0 * np.sqrt(count), (count, 1, 2))
    points = rng.uniform([-2.0, -1.0], [2.0, 1.0], (count, 24, 2))
    angle = rng.uniform(-np.pi, np.pi, count)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = np.einsum("ijn,nkj->nki", rotation, points) + places
    return flat(list(hulls_of_groups(moved.reshape(-1, 2), np.arange(count + 1) * 24).polygons()))


def overlaps_by_shapely(one: HullList, other: HullList) -> float:
    """Total shared area, by a tree of bounds."""
    a, b = (np.array([shapely.Polygon(p) for p in each.polygons()]) for each in (one, other))
    i, j = shapely.STRtree(b).query(a, predicate="intersects")
    return float(shapely.area(shapely.intersection(a[i], b[j])).sum())


def fastest_ms(work: Callable[[], Any], repeat: int) -> float:
    best = np.inf
    for _ in range(repeat):
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
    return 1e3 * best


def cases(quick: bool) -> list[tuple[str, Callable[[], Any], Callable[[], Any], Any]]:
    """Name, compiled, shapely's, and the comparison of both results."""

    def close(compiled: Any, theirs: Any) -> None:
        np.testing.assert_allclose(compiled, theirs, atol=1e-9)

    a, b = boxes(100, 1), boxes(120, 2)
    crowd = boxes(300, 3, 20.0)
    distance = np.hypot(*(crowd[:, None, :2] - crowd[None, :, :2]).T)
    pairs = np.nonzero(np.triu(distance < 3.0, 1))
    one, start = groups(20 if quick else 80, 5_000 if quick else 50_000)
    upright = [np.column_stack([x[:, :2], x[:, :2] + x[:, 3:5]]) for x in (a, b)]
    sets = [(hulls(count, 1), hulls(count, 2)) for count in ((60,) if quick else (60, 300, 1000))]
    pieces = np.concatenate(hulls(2, 1).polygons())
    return [
        *(
            (
                f"overlap of 2 x {len(first.polygons())} hulls",
                lambda first=first, other=other: overlaps(first, other).area_m2.sum(),
                lambda first=first, other=other: overlaps_by_shapely(first, other),
                close,
            )
            for first, other in sets
        ),
        (
            "join two pieces",
            lambda: hulls_of_groups(pieces, np.array([0, len(pieces)])),
            lambda: hulls_by_shapely(pieces, np.array([0, len(pieces)])),
            check_hulls,
        ),
        (
            f"hulls, {len(start) - 1} groups of {start[-1]} points",
            lambda: hulls_of_groups(one, start),
            lambda: hulls_by_shapely(one, start),
            check_hulls,
        ),
        ("IoU, 100 x 120 boxes", lambda: bev_iou(a, b), lambda: iou_by_shapely(a, b), close),
        ("GIoU, 100 x 120 boxes", lambda: giou_bev(a, b), lambda: giou_by_shapely(a, b), close),
        (
            f"suppression, {len(pairs[0])} listed pairs",
            lambda: uncovered(crowd, pairs, SUPPRESSED),
            lambda: uncovered_by_shapely(crowd, pairs, SUPPRESSED),
            close,
        ),
        (
            "IoU, 100 x 120 upright",
            lambda: rectangle_iou(*upright),
            lambda: upright_by_shapely(*upright),
            close,
        ),
    ]


def main() -> None:
    options = arguments(__doc__ or "")
    rows = []
    for name, compiled, theirs, compare in cases(options.quick):
        compare(compiled(), theirs())
        repeat = 10 if options.quick else 50
        compiled_ms, shapely_ms = fastest_ms(compiled, repeat), fastest_ms(theirs, repeat)
        ratio = shapely_ms / compiled_ms
        rows.append(
            {"what": name, "compiled ms": compiled_ms, "shapely ms": shapely_ms, "ratio": ratio}
        )
    report(rows, options.json)


if __name__ == "__main__":
    main()
