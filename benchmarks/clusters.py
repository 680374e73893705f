"""From a sweep of 100,000 points to clusters, stage by stage, on one core.

CPU milliseconds: the minimum and the median over repeated frames of a drive past walls, parked
vehicles and trees on a sloping road. The peer column repeats the stage with the usual library:
connected components with `scipy.ndimage.label` on the whole grid, hulls with `shapely`.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TypeVar

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import shapely
from _common import arguments, report
from numpy.typing import NDArray

from mottrack.core import Frame, Pose, Sweep
from mottrack.geometry.hulls import hulls_of_groups
from mottrack.lidar.terrain import Terrain
from mottrack.objects.cluster_points import ClusterPoints, PointLimits, group_points, kept_points
from mottrack.objects.clustering import component_labels, split_large
from mottrack.objects.clusters import ClusterSource
from mottrack.trackers.fixed_lag import FixedLagTracker

T = TypeVar("T")
CELLS, CELL_M = 566, 0.25
LIMITS = PointLimits(0.3, 2.0, 2.5, 50.0, CELL_M)


def street(points: int, frames: int, seed: int = 0) -> list[Sweep]:
    """A drive along a sloping street; points are drawn on surfaces, denser when near."""
    rng = np.random.default_rng(seed)
    boxes = np.column_stack(
        [
            rng.uniform(-60, 80, 150),
            rng.choice([-1, 1], 150) * rng.uniform(4, 45, 150),
            rng.uniform(0.4, 4.5, 150),
            rng.uniform(0.4, 2.0, 150),
            rng.uniform(0.8, 2.5, 150),
        ]
    )
    sweeps = []
    for k in range(frames):
        ego_x = k * 0.8
        ground = rng.normal(size=(points // 2, 2)) * 18
        share = rng.integers(0, len(boxes), points - len(ground))
        side = rng.uniform(-0.5, 0.5, (len(share), 2)) * boxes[share, 2:4]
        face = rng.integers(0, 2, len(share))
        side[face == 0, 0] = -0.5 * boxes[share[face == 0], 2]
        side[face == 1, 1] = -0.5 * boxes[share[face == 1], 3]
        xy = boxes[share, :2] + side - [ego_x, 0]
        z = rng.uniform(0, 1, len(share)) * boxes[share, 4]
        xyz = np.concatenate(
            [np.column_stack([ground, np.zeros(len(ground))]), np.column_stack([xy, z])]
        )
        xyz[:, 2] += 0.03 * (xyz[:, 0] + ego_x) - 1.8 + 0.02 * rng.normal(size=len(xyz))
        pose = Pose(np.eye(3), np.array([ego_x, 0.0, 0.0]))
        reflectance = np.zeros(len(xyz), np.float32)
        sweeps.append(Sweep(xyz.astype(np.float32), reflectance, (k + 1) * 10**8, pose))
    return sweeps


class Chain:
    """CPU milliseconds by stage."""

    def __init__(self) -> None:
        self.times: dict[str, list[float]] = {}

    def timed(self, stage: str, work: Callable[[], T]) -> T:
        start = time.process_time()
        result = work()
        self.times.setdefault(stage, []).append((time.process_time() - start) * 1e3)
        return result


def by_shapely(groups: ClusterPoints) -> NDArray[np.object_]:
    owner = np.repeat(np.arange(len(groups.start) - 1), np.diff(groups.start))
    return shapely.convex_hull(shapely.linestrings(groups.xy_m, indices=owner))


def stages(chain: Chain, terrain: Terrain, sweep: Sweep) -> int:
    corner_m = np.round(sweep.world_T_ego.translation_m[:2] / CELL_M) * CELL_M - CELLS * CELL_M / 2
    chain.timed("terrain", lambda: terrain.update(sweep))
    height_m = chain.timed("height of points", lambda: terrain.height_above_m(sweep))
    points = chain.timed("filter", lambda: kept_points(sweep, height_m, corner_m, LIMITS, CELLS))
    occupied = np.zeros((CELLS, CELLS), np.bool_)

    def occupy() -> None:
        occupied[points.row, points.column] = True

    chain.timed("occupancy", occupy)
    cells = chain.timed("components", lambda: component_labels(occupied, None, 1))
    cells = chain.timed("tiles", lambda: split_large(cells, 40, (0, 0)))

    def group() -> ClusterPoints:
        label = cells.of(points.row, points.column, occupied.shape)
        return group_points(points, label, cells.number, 4)

    groups = chain.timed("grouping", group)
    hulls = chain.timed("hulls", lambda: hulls_of_groups(groups.xy_m, groups.start))
    polygons = chain.timed("hulls, shapely", lambda: by_shapely(groups))
    polygons_m = hulls.polygons()
    area = sum(shapely.Polygon(polygon).area for polygon in polygons_m)
    if not np.isclose(area, shapely.area(polygons).sum(), rtol=1e-2):
        raise SystemExit("hulls differ from shapely's")
    return len(polygons_m)


def main() -> None:
    options = arguments(__doc__ or "", points=int)
    points = options.points or 100_000
    sweeps = street(points, 12 if options.quick else 60)
    chain, terrain = Chain(), Terrain()
    clusters = 0
    for sweep in sweeps:
        clusters = stages(chain, terrain, sweep)
    source, tracker = ClusterSource(), FixedLagTracker()
    for sweep in sweeps:
        frame = Frame(sweep.stamp_ns, sweep.world_T_ego)
        objects = chain.timed("all to clusters", lambda s=sweep, f=frame: source.objects(f, s))
        chain.timed("tracker", lambda o=objects: tracker.step(o.stamp_ns, o))
    both = zip(chain.times["all to clusters"], chain.times["tracker"], strict=True)
    chain.times["sweep to tracks"] = [a + b for a, b in both]
    lines = []
    for stage, times in chain.times.items():
        settled = np.array(times[4:])
        lines.append(
            {
                "stage": stage,
                "min_ms": float(settled.min()),
                "median_ms": float(np.median(settled)),
                "p99_ms": float(np.percentile(settled, 99)),
            }
        )
    print(f"{points} points, {clusters} clusters, {len(sweeps)} sweeps")
    report(lines, options.json)


if __name__ == "__main__":
    main()
