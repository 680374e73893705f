"""How well one cluster of points, moved, explains another sweep.

Kernels on plain arrays. All distances are three-dimensional; motion is planar.
"""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64
from mottrack.lidar.point_grid import PointGrid, nearest


@compiled
def capped_residual(
    grid: PointGrid, points_m: F32, shift_m: tuple[float, float], cap_m: float
) -> float:
    """Mean distance of `points_m` (N, 3), shifted in the plane, to the grid's nearest points.

    A distance counts at most `cap_m`, so that what is missing weighs the same however far off.
    """
    total = 0.0
    for i in range(len(points_m)):
        _, d2 = nearest(
            grid, points_m[i, 0] + shift_m[0], points_m[i, 1] + shift_m[1], points_m[i, 2], cap_m
        )
        total += np.sqrt(d2)
    return total / max(len(points_m), 1)


@compiled
def capped_residuals(grid: PointGrid, points_m: F32, shifts_m: F64, cap_m: float) -> F64:
    """`capped_residual` of each planar shift (K, 2)."""
    residual_m = np.empty(len(shifts_m))
    for k in range(len(shifts_m)):
        residual_m[k] = capped_residual(grid, points_m, (shifts_m[k, 0], shifts_m[k, 1]), cap_m)
    return residual_m


@compiled
def box_residual(
    grid: PointGrid,
    cluster: PointGrid,
    box: F64,
    offset_m: tuple[float, float, float],
    cap_m: float,
) -> float:
    """Mean capped distance of the grid's points inside a box to a cluster moved by `offset_m`.

    The way back: what of the other sweep, where the cluster is said to have been, it does not
    explain. `box` (8,): centre, half sizes, cosine and sine of the heading. An empty box explains
    nothing: the cap.
    """
    total, count = 0.0, 0
    reach_m = np.hypot(box[3], box[4])
    col_low = max(int((box[0] - reach_m - grid.x_min_m) // grid.cell_m), 0)
    col_high = min(int((box[0] + reach_m - grid.x_min_m) // grid.cell_m), grid.cols - 1)
    row_low = max(int((box[1] - reach_m - grid.y_min_m) // grid.cell_m), 0)
    row_high = min(int((box[1] + reach_m - grid.y_min_m) // grid.cell_m), grid.rows - 1)
    for row in range(row_low, row_high + 1):
        low = grid.start[row * grid.cols + min(col_low, grid.cols - 1)]
        high = grid.start[row * grid.cols + max(col_high, -1) + 1]
        for k in range(low, high):
            point = grid.xyz_m[k]
            dx, dy = point[0] - box[0], point[1] - box[1]
            inside = abs(dx * box[6] + dy * box[7]) <= box[3]
            inside &= abs(dy * box[6] - dx * box[7]) <= box[4]
            if inside and abs(point[2] - box[2]) <= box[5]:
                _, d2 = nearest(
                    cluster,
                    point[0] - offset_m[0],
                    point[1] - offset_m[1],
                    point[2] - offset_m[2],
                    cap_m,
                )
                total += np.sqrt(d2)
                count += 1
    return total / count if count else cap_m


@compiled
def translation_icp(
    grid: PointGrid,
    points_m: F32,
    start_m: tuple[float, float],
    gates_m: F64,
) -> tuple[float, float]:
    """Planar shift (x, y) of `points_m` onto the grid's points, one step for each gate.

    Each step is the mean pair difference with weights 1 / (0.1 + d): near pairs decide, and a
    point whose partner is hidden does not pull.
    """
    x_m, y_m = start_m
    for gate_m in gates_m:
        weight, step_x, step_y = 1e-12, 0.0, 0.0
        for i in range(len(points_m)):
            px, py = points_m[i, 0] + x_m, points_m[i, 1] + y_m
            k, d2 = nearest(grid, px, py, points_m[i, 2], gate_m)
            if k >= 0:
                w = 1.0 / (0.1 + np.sqrt(d2))
                weight += w
                step_x += w * (grid.xyz_m[k, 0] - px)
                step_y += w * (grid.xyz_m[k, 1] - py)
        x_m += step_x / weight
        y_m += step_y / weight
        if abs(step_x) + abs(step_y) < 1e-3 * weight:
            break
    return x_m, y_m
