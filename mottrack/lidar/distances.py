"""Distances from points to the nearest ones of another sweep, compiled."""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64
from mottrack.lidar.point_grid import PointGrid, nearest


@compiled
def truncated_distances(grid: PointGrid, points_m: F32, truncation_m: float) -> F64:
    """Return (N,) the 3-D distances of points (N, 3) to the nearest of the grid, truncated."""
    distance_m = np.empty(len(points_m))
    for i in range(len(points_m)):
        _, d2 = nearest(grid, points_m[i, 0], points_m[i, 1], points_m[i, 2], truncation_m)
        distance_m[i] = np.sqrt(d2)
    return distance_m
