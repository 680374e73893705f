"""What a sweep could see: a polar free-space raster.

Every return says that its ray was free up to there. Per azimuth the farthest return, ground
included, bounds what was seen from the optical centre; a cell beyond it was hidden, and nothing
is known about what stood there.
"""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I8
from mottrack.core.grid import BevGrid
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.lidar.azimuth import quick_atan2

UNSEEN, FREE, OCCUPIED = 0, 1, 2
_BINS = 720
"""0.5 degrees: wider than the azimuth step of any rotating LiDAR, so that no bin stays empty."""


def farthest_returns(sweep: Sweep) -> F64:
    """(720,) horizontal range of the farthest return in each half degree about the optical centre.

    All returns count, ground included, in the frame of the sweep.
    """
    return np.asarray(
        _farthest(np.array(sweep.xyz_m), float(sweep.origin_m[0]), float(sweep.origin_m[1]))
    )


def visibility_raster(
    sweep: Sweep,
    farthest_m: F64,
    grid: BevGrid,
    sweep_T_grid: Pose | None = None,
) -> I8:
    """(H, W) whether a sweep saw each cell: UNSEEN or FREE.

    Args:
        sweep: the sweep, whose optical centre counts.
        farthest_m: its `farthest_returns`.
        grid: the raster.
        sweep_T_grid: from the frame of the grid to that of the sweep; the same if left out.
    """
    pose = sweep_T_grid or Pose.identity()
    seen = np.empty(grid.shape, np.int8)
    offset_m = pose.translation_m[:2] - sweep.origin_m[:2]
    _fill(
        seen,
        farthest_m,
        (grid.x_min_m, grid.y_min_m, grid.cell_m),
        (np.ascontiguousarray(pose.rotation[:2, :2]), np.ascontiguousarray(offset_m)),
    )
    return seen


def with_returns(seen: I8, kept_xyz_m: F32, grid: BevGrid) -> I8:
    """The raster (H, W) with OCCUPIED where a kept (non-ground) point (N, 3) lies."""
    return np.where(grid.occupancy(kept_xyz_m), np.int8(OCCUPIED), seen)


@compiled
def _bin_of(x_m: float, y_m: float) -> int:
    return int((quick_atan2(y_m, x_m) + np.pi) * (_BINS / (2 * np.pi))) % _BINS


@compiled
def _farthest(xyz_m: F32, centre_x_m: float, centre_y_m: float) -> F64:
    farthest_m2 = np.zeros(_BINS)
    for i in range(len(xyz_m)):
        dx, dy = xyz_m[i, 0] - centre_x_m, xyz_m[i, 1] - centre_y_m
        k = _bin_of(dx, dy)
        farthest_m2[k] = max(farthest_m2[k], dx * dx + dy * dy)
    return np.sqrt(farthest_m2)


@compiled
def _fill(
    seen: I8,
    farthest_m: F64,
    extent: tuple[float, float, float],
    moved: tuple[F64, F64],
) -> None:
    x_min_m, y_min_m, cell_m = extent
    turn, offset_m = moved
    for row in range(seen.shape[0]):
        y_m = y_min_m + (row + 0.5) * cell_m
        for col in range(seen.shape[1]):
            x_m = x_min_m + (col + 0.5) * cell_m
            dx = turn[0, 0] * x_m + turn[0, 1] * y_m + offset_m[0]
            dy = turn[1, 0] * x_m + turn[1, 1] * y_m + offset_m[1]
            limit_m = farthest_m[_bin_of(dx, dy)]
            seen[row, col] = FREE if dx * dx + dy * dy <= limit_m * limit_m else UNSEEN
