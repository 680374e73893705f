"""Truncated point-to-point residuals of a moved cluster, and translation-only ICP, compiled.

All distances are three-dimensional; motion is planar. A distance counts at most the truncation
distance, so that a missing counterpart weighs the same however far off it is.
"""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64
from mottrack.lidar.point_grid import PointGrid, cells_within, nearest

SOFTENING_M = 0.1
"""In the weight 1 / (0.1 + d) of a pair: far pairs count less (an L1 norm), but none counts without
bound. About the spacing of the points of a surface, below which distances say nothing."""


@compiled
def truncated_residual(
    grid: PointGrid, points_m: F32, shift_m: tuple[float, float], truncation_m: float
) -> float:
    """Return the mean truncated distance of points (N, 3), shifted by x and y, to the grid's."""
    total = 0.0
    for i in range(len(points_m)):
        x_m, y_m = points_m[i, 0] + shift_m[0], points_m[i, 1] + shift_m[1]
        _, d2 = nearest(grid, x_m, y_m, points_m[i, 2], truncation_m)
        total += np.sqrt(d2)
    return total / max(len(points_m), 1)


@compiled
def truncated_residuals(grid: PointGrid, points_m: F32, shifts_m: F64, truncation_m: float) -> F64:
    """Return the `truncated_residual` of each planar shift (K, 2)."""
    residual_m = np.empty(len(shifts_m))
    for k in range(len(shifts_m)):
        shift_m = (shifts_m[k, 0], shifts_m[k, 1])
        residual_m[k] = truncated_residual(grid, points_m, shift_m, truncation_m)
    return residual_m


@compiled
def box_residual(
    grid: PointGrid, cluster: PointGrid, box: F64, offset_m: F64, truncation_m: float
) -> float:
    """Return the mean truncated distance of the grid's points in a box to the moved cluster.

    The reverse direction: what the cluster leaves unexplained of the other sweep, where it is said
    to have been. An empty box gives the truncation distance.

    Args:
        grid: points of the other sweep.
        cluster: the cluster's points about its centroid.
        box: (8,) centre, half sizes, cosine and sine of the heading, in the frame of `grid`.
        offset_m: (3,) place of the moved cluster's centroid.
        truncation_m: truncation distance.
    """
    total, count = 0.0, 0
    reach_m = np.hypot(box[3], box[4])
    col_low, col_high, row_low, row_high = cells_within(
        grid, box[0] - reach_m, box[0] + reach_m, box[1] - reach_m, box[1] + reach_m
    )
    if col_low > col_high:
        return truncation_m
    for row in range(row_low, row_high + 1):
        first = grid.start[row * grid.cols + col_low]
        last = grid.start[row * grid.cols + col_high + 1]
        for k in range(first, last):
            point = grid.xyz_m[k]
            dx, dy = point[0] - box[0], point[1] - box[1]
            inside = abs(dx * box[6] + dy * box[7]) <= box[3]
            inside &= abs(dy * box[6] - dx * box[7]) <= box[4]
            if inside and abs(point[2] - box[2]) <= box[5]:
                x_m, y_m, z_m = point[0] - offset_m[0], point[1] - offset_m[1], point[2]
                _, d2 = nearest(cluster, x_m, y_m, z_m - offset_m[2], truncation_m)
                total += np.sqrt(d2)
                count += 1
    return total / count if count else truncation_m


@compiled
def translation_icp(
    grid: PointGrid, points_m: F32, start_m: tuple[float, float], gates_m: F64
) -> tuple[float, float]:
    """Return the planar shift of points (N, 3) onto the grid's, by one ICP step for each gate.

    Each step is the mean pair difference with weights 1 / (0.1 + d): near pairs decide, and a
    point whose counterpart is occluded does not pull. Steps below 1 mm end it.
    """
    x_m, y_m = start_m
    for gate_m in gates_m:
        weight, step_x, step_y = 1e-12, 0.0, 0.0  # no division by zero without pairs
        for i in range(len(points_m)):
            px, py = points_m[i, 0] + x_m, points_m[i, 1] + y_m
            k, d2 = nearest(grid, px, py, points_m[i, 2], gate_m)
            if k >= 0:
                w = 1.0 / (SOFTENING_M + np.sqrt(d2))
                weight += w
                step_x += w * (grid.xyz_m[k, 0] - px)
                step_y += w * (grid.xyz_m[k, 1] - py)
        x_m += step_x / weight
        y_m += step_y / weight
        if abs(step_x) + abs(step_y) < 1e-3 * weight:
            break
    return x_m, y_m
