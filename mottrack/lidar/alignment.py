"""Residual ego motion between two sweeps after odometry, by robust planar ICP.

A pose error of a few centimetres makes every wall move: it is the strongest outside influence on
flow. The non-ground points of both sweeps agree where the world is static, and ICP finds the small
motion that is left. The correction is bounded: a large one is a failure of the registration, not
of the odometry.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64
from mottrack.core.pose import Pose
from mottrack.lidar.point_grid import PointGrid, build_point_grid, first_in_voxel, nearest
from mottrack.lidar.residual import SOFTENING_M

_MIN_PAIRS = 50
"""Fewer pairs do not average out the sampling noise of single points."""
_VOXEL_M = 0.15
"""One point of the current sweep per cube: the sampling noise averages out over the pairs."""
_SPREAD_M = 0.25
"""One point of the previous sweep per cube: far walls, which determine the rotation best, hold few
of the returns."""
_LEVER_M = 30.0
"""Distance at which the convergence test weighs a rotation: that of the far walls."""


class AlignmentConfig(StrictModel):
    """Robust planar ICP of the previous sweep to the current one."""

    max_points: int = Field(3000, ge=100, description="points of the previous sweep that are used")
    iterations: int = Field(15, ge=1, description="steps of the ICP")
    gate_m: float = Field(0.6, gt=0, description="farthest pair at the start; shrinks to a third")
    max_shift_m: float = Field(0.3, ge=0, description="a larger correction is refused")
    max_turn_rad: float = Field(0.0175, ge=0, description="a larger correction is refused")
    seed: int = Field(0, ge=0, description="seed of the choice of points")


class _Motion(NamedTuple):
    """A rotation about the origin, then a shift, in the plane."""

    x_m: float
    y_m: float
    turn_rad: float


class _NormalEquations(NamedTuple):
    matrix: F64
    """(3, 3) for steps of `_Motion`."""
    vector: F64
    """(3,)."""
    pairs: int


class AlignmentTarget:
    """The sweep that others are aligned to: indexed once, on first use."""

    def __init__(self, current_m: F32, config: AlignmentConfig | None = None) -> None:
        """Keep the non-ground points (N, 3) of the current sweep in its ego frame."""
        self.current_m, self.config = current_m, config or AlignmentConfig()

    @cached_property
    def grid(self) -> PointGrid:
        """The thinned points."""
        thinned_m = self.current_m.take(first_in_voxel(self.current_m, _VOXEL_M), axis=0)
        return build_point_grid(thinned_m, self.config.gate_m / 2)


def residual_motion(previous_m: F32, target: AlignmentTarget) -> Pose:
    """Return `aligned_T_compensated`, which moves the previous points (N, 3) onto the target.

    They are non-ground points in the current ego frame, ego motion removed. The identity where
    there are too few pairs or the correction exceeds its bounds.
    """
    config = target.config
    if len(previous_m) < _MIN_PAIRS or len(target.current_m) < _MIN_PAIRS:
        return Pose.identity()
    rng = np.random.default_rng(config.seed)
    spread = rng.permutation(first_in_voxel(previous_m, _SPREAD_M))[: config.max_points]
    gates_m = np.geomspace(config.gate_m, config.gate_m / 3, config.iterations)
    found = _planar_icp(target.grid, previous_m[spread], gates_m)
    too_far = np.hypot(found.x_m, found.y_m) > config.max_shift_m
    if too_far or abs(found.turn_rad) > config.max_turn_rad:
        return Pose.identity()
    return Pose.from_yaw(found.turn_rad, (found.x_m, found.y_m, 0.0))


@compiled
def _planar_icp(grid: PointGrid, points_m: F32, gates_m: F64) -> _Motion:
    """Register `points_m` to the grid's points; weights 1 / (0.1 + d), least squares."""
    motion = _Motion(0.0, 0.0, 0.0)
    for gate_m in gates_m:
        normal = _normal_equations(grid, points_m, motion, gate_m)
        if normal.pairs < _MIN_PAIRS:
            return _Motion(0.0, 0.0, 0.0)
        step = np.linalg.solve(normal.matrix, normal.vector)
        motion = _Motion(motion.x_m + step[0], motion.y_m + step[1], motion.turn_rad + step[2])
        if abs(step[0]) + abs(step[1]) + _LEVER_M * abs(step[2]) < 1e-3:  # one millimetre
            break
    return motion


@compiled
def _normal_equations(
    grid: PointGrid, points_m: F32, motion: _Motion, gate_m: float
) -> _NormalEquations:
    x_m, y_m, turn_rad = motion
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    # 1e-9 keeps the matrix regular where all points lie on the axis of the rotation
    w, wu, wv, wuu, fx, fy, ft, pairs = 0.0, 0.0, 0.0, 1e-9, 0.0, 0.0, 0.0, 0
    for i in range(len(points_m)):
        # (u, v): the rotated point, by which the angle acts: d(x, y) / d(turn) = (-v, u)
        u = cos * points_m[i, 0] - sin * points_m[i, 1]
        v = sin * points_m[i, 0] + cos * points_m[i, 1]
        k, d2 = nearest(grid, u + x_m, v + y_m, points_m[i, 2], gate_m)
        if k < 0:
            continue
        weight = 1.0 / (SOFTENING_M + np.sqrt(d2))
        error_x = grid.xyz_m[k, 0] - u - x_m
        error_y = grid.xyz_m[k, 1] - v - y_m
        pairs += 1
        w += weight
        wu += weight * u
        wv += weight * v
        wuu += weight * (u * u + v * v)
        fx += weight * error_x
        fy += weight * error_y
        ft += weight * (u * error_y - v * error_x)
    matrix = np.array([[w, 0.0, -wv], [0.0, w, wu], [-wv, wu, wuu]])
    return _NormalEquations(matrix, np.array([fx, fy, ft]), pairs)
