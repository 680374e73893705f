"""What is left of the vehicle's own motion between two sweeps, after odometry.

A pose error of a few centimetres makes every wall move: it is the strongest outside influence on
flow. The non-ground points of both sweeps agree where the world stands still, and a robust,
planar ICP finds the small motion that is left. The correction is capped: a large one is a failure
of the registration, not of the odometry.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64
from mottrack.core.pose import Pose
from mottrack.lidar.point_grid import PointGrid, build_point_grid, nearest
from mottrack.lidar.thinning import first_in_voxel

_MIN_PAIRS = 50
_VOXEL_M = 0.15
"""One point of the current sweep per cube: the sampling noise averages out over the pairs."""


class AlignmentConfig(StrictModel):
    """Robust planar ICP of the previous sweep to the current one."""

    max_points: int = Field(3000, ge=100, description="points of the previous sweep that are used")
    iterations: int = Field(15, ge=1, description="steps of the ICP")
    gate_m: float = Field(0.6, gt=0, description="farthest pair at the start; shrinks to a third")
    max_shift_m: float = Field(0.3, ge=0, description="a larger correction is refused")
    max_turn_rad: float = Field(0.0175, ge=0, description="a larger correction is refused")
    seed: int = Field(0, ge=0, description="seed of the choice of points")


def residual_motion(
    previous_m: F32,
    current_m: F32,
    config: AlignmentConfig | None = None,
) -> Pose:
    """`aligned_T_compensated`: what moves the previous points (N, 3) onto the current (M, 3).

    Both are non-ground points in the current ego frame, ego motion removed. The identity where
    there are too few pairs or the correction exceeds its cap.
    """
    config = config or AlignmentConfig()
    if len(previous_m) < _MIN_PAIRS or len(current_m) < _MIN_PAIRS:
        return Pose.identity()
    chosen = _spread(previous_m, config)
    thinned = np.array(current_m[first_in_voxel(current_m, _VOXEL_M)])
    grid = build_point_grid(thinned, config.gate_m / 2)
    gates_m = np.geomspace(config.gate_m, config.gate_m / 3, config.iterations)
    x_m, y_m, turn_rad = _planar_icp(grid, chosen, gates_m)
    if np.hypot(x_m, y_m) > config.max_shift_m or abs(turn_rad) > config.max_turn_rad:
        return Pose.identity()
    return Pose.from_yaw(turn_rad, (x_m, y_m, 0.0))


def _spread(xyz_m: F32, config: AlignmentConfig) -> F32:
    """At most `max_points` points, one for each quarter-metre cell.

    Walls far away tell the turn best, and those close by hold most of the returns.
    """
    first = first_in_voxel(xyz_m, 0.25)
    rng = np.random.default_rng(config.seed)
    return np.array(xyz_m[rng.permutation(first)[: config.max_points]])


@compiled
def _planar_icp(grid: PointGrid, points_m: F32, gates_m: F64) -> tuple[float, float, float]:
    """Shift and turn of `points_m` onto the grid's points; weights 1 / (0.1 + d), least squares."""
    shift_x, shift_y, turn = 0.0, 0.0, 0.0
    for gate_m in gates_m:
        normal, right, pairs = _normal_equations(grid, points_m, (shift_x, shift_y, turn), gate_m)
        if pairs < _MIN_PAIRS:
            return 0.0, 0.0, 0.0
        step = np.linalg.solve(normal, right)
        shift_x += step[0]
        shift_y += step[1]
        turn += step[2]
        if abs(step[0]) + abs(step[1]) + 30 * abs(step[2]) < 1e-3:
            break
    return shift_x, shift_y, turn


@compiled
def _normal_equations(
    grid: PointGrid,
    points_m: F32,
    motion: tuple[float, float, float],
    gate_m: float,
) -> tuple[F64, F64, int]:
    cos, sin = np.cos(motion[2]), np.sin(motion[2])
    w, wu, wv, wuu, fx, fy, ft, pairs = 0.0, 0.0, 0.0, 1e-9, 0.0, 0.0, 0.0, 0
    for i in range(len(points_m)):
        # (u, v): the turned point, by which the angle acts: d(x, y) / d(turn) = (-v, u)
        u = cos * points_m[i, 0] - sin * points_m[i, 1]
        v = sin * points_m[i, 0] + cos * points_m[i, 1]
        k, d2 = nearest(grid, u + motion[0], v + motion[1], points_m[i, 2], gate_m)
        if k < 0:
            continue
        weight = 1.0 / (0.1 + np.sqrt(d2))
        error_x = grid.xyz_m[k, 0] - u - motion[0]
        error_y = grid.xyz_m[k, 1] - v - motion[1]
        pairs += 1
        w += weight
        wu += weight * u
        wv += weight * v
        wuu += weight * (u * u + v * v)
        fx += weight * error_x
        fy += weight * error_y
        ft += weight * (u * error_y - v * error_x)
    normal = np.array([[w, 0.0, -wv], [0.0, w, wu], [-wv, wu, wuu]])
    return normal, np.array([fx, fy, ft]), pairs
