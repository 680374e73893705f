"""Points of a sweep that may belong to objects, and their grouping by cluster (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64
from mottrack.core.sweep import Sweep


class PointLimits(NamedTuple):
    """Which points of a sweep are clustered."""

    low_m: float
    """Lowest height above ground."""
    high_m: float
    """Highest height above ground."""
    near_m: float
    """Shortest range: nearer points lie on the vehicle."""
    reach_m: float
    """Half the side of the square around the vehicle, in its axes."""
    cell_m: float
    """Side of a cell of the grid."""


class KeptPoints(NamedTuple):
    """Points within the limits, with the cell they fall into."""

    xyz_m: F64
    """(M, 3) x, y from the grid's corner, z in the world frame."""
    row: I64
    """(M,)."""
    column: I64
    """(M,)."""


class ClusterPoints(NamedTuple):
    """The points of G clusters, one cluster after the other."""

    xy_m: F64
    """(K, 2) from the grid's corner."""
    start: I64
    """(G + 1,) first point of each cluster."""
    bottom_m: F64
    """(G,) lowest point, world frame."""
    top_m: F64
    """(G,) highest point, world frame."""
    cell_mean_m: F64
    """(G, 2) mean of the occupied cells, each counted once."""


def kept_points(
    sweep: Sweep, height_m: F64, corner_m: F64, limits: PointLimits, cells: int
) -> KeptPoints:
    """Return the points within the limits and the grid.

    Args:
        sweep: N points.
        height_m: (N,) height above ground.
        corner_m: (2,) world position of the grid's corner.
        limits: which points are kept.
        cells: per side of the grid.
    """
    grid_T_ego = sweep.world_T_ego.matrix
    grid_T_ego[:2, 3] -= corner_m
    return _kept(sweep.xyz_m, height_m, grid_T_ego, limits, cells)


@compiled
def _kept(
    xyz_m: F32, height_m: F64, grid_T_ego: F64, limits: PointLimits, cells: int
) -> KeptPoints:
    rotation, offset_m = grid_T_ego[:3, :3], grid_T_ego[:3, 3]
    low, high, near, reach_m, cell_m = limits
    moved = np.empty((len(xyz_m), 3))
    row, column = np.empty(len(xyz_m), np.int64), np.empty(len(xyz_m), np.int64)
    count = 0
    for i in range(len(xyz_m)):
        x, y, z = xyz_m[i]
        if not (low <= height_m[i] <= high) or max(abs(x), abs(y)) > reach_m:
            continue
        if x * x + y * y < near * near:
            continue
        east = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + offset_m[0]
        north = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + offset_m[1]
        c, r = int(np.floor(east / cell_m)), int(np.floor(north / cell_m))
        if 0 <= r < cells and 0 <= c < cells:
            moved[count, 0], moved[count, 1] = east, north
            up = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + offset_m[2]
            moved[count, 2] = up
            row[count], column[count] = r, c
            count += 1
    return KeptPoints(moved[:count].copy(), row[:count].copy(), column[:count].copy())


def group_points(points: KeptPoints, cluster: I64, clusters: int, min_points: int) -> ClusterPoints:
    """Sort points by `cluster` (M,) in 0..clusters-1; drop clusters below `min_points`."""
    sizes = np.bincount(cluster, minlength=clusters)
    kept = sizes >= min_points
    dense = np.where(kept, np.cumsum(kept) - 1, -1)
    start = np.concatenate([[0], np.cumsum(sizes[kept])]).astype(np.int64)
    return _grouped(points, dense[cluster], start)


@compiled
def _grouped(points: KeptPoints, cluster: I64, start: I64) -> ClusterPoints:
    """Group points; those of cluster -1 are left out."""
    groups = len(start) - 1
    fill = start[:-1].copy()
    xy_m = np.empty((start[-1], 2))
    bottom_m, top_m = np.full(groups, np.inf), np.full(groups, -np.inf)
    mean_m, total = np.zeros((groups, 2)), np.zeros(groups)
    weight = _cell_weights(points.row, points.column)
    for i in range(len(cluster)):
        g = cluster[i]
        if g >= 0:
            x, y, z = points.xyz_m[i, 0], points.xyz_m[i, 1], points.xyz_m[i, 2]
            xy_m[fill[g], 0], xy_m[fill[g], 1] = x, y
            fill[g] += 1
            bottom_m[g], top_m[g] = min(bottom_m[g], z), max(top_m[g], z)
            share = weight[points.row[i], points.column[i]]
            total[g] += share
            mean_m[g, 0] += share * x
            mean_m[g, 1] += share * y
    return ClusterPoints(xy_m, start, bottom_m, top_m, mean_m / total.reshape(-1, 1))


@compiled
def _cell_weights(row: I64, column: I64) -> F64:
    """Return 1 / (number of points) of each cell."""
    if len(row) == 0:
        return np.zeros((1, 1))
    weight = np.zeros((np.max(row) + 1, np.max(column) + 1))
    for i in range(len(row)):
        weight[row[i], column[i]] += 1.0
    return 1.0 / np.maximum(weight, 1.0)
