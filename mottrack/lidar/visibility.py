"""Free space and occlusion of a sweep, from above (2-D raster) and per direction (range image).

Every return shows that its ray was free up to there. In the raster the farthest return of each
azimuth, ground included, bounds what was seen from the optical centre. The range image adds the
elevation: a point in front of the returns of its neighbouring rays, above and below, lies in free
space; a point behind one of them may have been occluded. So what a ray passes over is not taken
for free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I8
from mottrack.core.grid import BevGrid
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep

UNSEEN, FREE, OCCUPIED = 0, 1, 2
"""States of a place: occluded or out of view; rays passed beyond it; returns on it."""
_BINS = 720
"""0.5 degrees: wider than the azimuth step of any rotating LiDAR, so that no bin stays empty."""
_COLUMNS = 900
"""0.4 degrees: at least one ray of any rotating LiDAR in each column of the range image."""
_ROWS_PER_RAD = 229.18
"""0.25 degrees: no two rays of a 128-ring sensor far apart in one row."""
_ROWS = 480
"""120 degrees about the horizon."""
_GAP_ROWS = 8
"""2 degrees: the widest gap between neighbouring rings."""
_MIN_NEIGHBOURS = 4
"""Of nine rays around a place that must all pass it; fewer are no evidence of free space."""


@compiled(fastmath=True)
def fast_atan2(y: float, x: float) -> float:
    """Return the angle of (x, y) in [-pi, pi], 1e-5 rad off at most; 0 at the origin.

    The odd polynomial of Abramowitz and Stegun 4.4.49 over one octant, unfolded by symmetry.
    """
    across, along = abs(y), abs(x)
    larger = max(across, along)
    if larger == 0.0:
        return 0.0
    t = min(across, along) / larger
    s = t * t
    angle = t * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    if across > along:
        angle = 0.5 * np.pi - angle
    if x < 0.0:
        angle = np.pi - angle
    return -angle if y < 0.0 else angle


def farthest_returns(sweep: Sweep) -> F64:
    """Return (720,) horizontal ranges of the farthest return in each half degree of azimuth.

    All returns count, ground included, about the optical centre, in the frame of the sweep.
    """
    centre_x_m, centre_y_m, _ = sweep.origin_m.tolist()
    return _farthest(np.array(sweep.xyz_m), centre_x_m, centre_y_m)


class _GridInSweep(NamedTuple):
    """A raster, and the planar transform of its cells to azimuths about the optical centre."""

    x_min_m: float
    y_min_m: float
    cell_m: float
    rotation: F64
    """(2, 2)."""
    offset_m: F64
    """(2,)."""


def visibility_raster(
    sweep: Sweep, farthest_m: F64, grid: BevGrid, sweep_T_grid: Pose | None = None
) -> I8:
    """Return (H, W) UNSEEN or FREE: whether a sweep saw each cell.

    Args:
        sweep: the sweep, of which the optical centre is used.
        farthest_m: its `farthest_returns`.
        grid: the raster.
        sweep_T_grid: from the frame of the grid to that of the sweep; the same if left out.
    """
    pose = sweep_T_grid or Pose.identity()
    rotation = np.ascontiguousarray(pose.rotation[:2, :2])
    offset_m = np.ascontiguousarray(pose.translation_m[:2] - sweep.origin_m[:2])
    placed = _GridInSweep(grid.x_min_m, grid.y_min_m, grid.cell_m, rotation, offset_m)
    seen = np.empty(grid.shape, np.int8)
    _fill_raster(seen, farthest_m, placed)
    return seen


def with_returns(seen: I8, obstacles_m: F32, grid: BevGrid) -> I8:
    """Return the raster (H, W) with OCCUPIED where a non-ground point (N, 3) lies."""
    return np.where(grid.occupancy(obstacles_m), np.int8(OCCUPIED), seen)


@compiled
def _azimuth_bin(x_m: float, y_m: float) -> int:
    return int((fast_atan2(y_m, x_m) + np.pi) * (_BINS / (2 * np.pi))) % _BINS


@compiled
def _farthest(xyz_m: F32, centre_x_m: float, centre_y_m: float) -> F64:
    farthest_m2 = np.zeros(_BINS)
    for i in range(len(xyz_m)):
        dx, dy = xyz_m[i, 0] - centre_x_m, xyz_m[i, 1] - centre_y_m
        k = _azimuth_bin(dx, dy)
        farthest_m2[k] = max(farthest_m2[k], dx * dx + dy * dy)
    return np.sqrt(farthest_m2)


@compiled
def _fill_raster(seen: I8, farthest_m: F64, placed: _GridInSweep) -> None:
    x_min_m, y_min_m, cell_m, rotation, offset_m = placed
    for row in range(seen.shape[0]):
        y_m = y_min_m + (row + 0.5) * cell_m
        for col in range(seen.shape[1]):
            x_m = x_min_m + (col + 0.5) * cell_m
            dx = rotation[0, 0] * x_m + rotation[0, 1] * y_m + offset_m[0]
            dy = rotation[1, 0] * x_m + rotation[1, 1] * y_m + offset_m[1]
            limit_m = farthest_m[_azimuth_bin(dx, dy)]
            seen[row, col] = FREE if dx * dx + dy * dy <= limit_m * limit_m else UNSEEN


class RangeImage(NamedTuple):
    """Nearest and farthest return per direction from the optical centre; 0 where none."""

    nearest_m: F32
    """(900, 480) by azimuth and elevation."""
    farthest_m: F32
    """(900, 480)."""
    rotation: F64
    """(3, 3) from the frame of the queried places to the frame of the sweep."""
    offset_m: F64
    """(3,) added after the rotation; relative to the optical centre."""


class _Direction(NamedTuple):
    row: int
    column: int
    range_m: float


def build_range_image(xyz_m: F32, origin_m: F64) -> RangeImage:
    """Return the range image of all returns (N, 3), ground included, about the optical centre."""
    nearest_m, farthest_m = _fill_image(np.array(xyz_m), np.array(origin_m))
    return RangeImage(nearest_m, farthest_m, np.eye(3), -origin_m)


def queried_from(image: RangeImage, sweep_T_frame: Pose) -> RangeImage:
    """Return the same image for queries in another frame: the returns stay where they are."""
    return image._replace(
        rotation=np.ascontiguousarray(sweep_T_frame.rotation),
        offset_m=sweep_T_frame.translation_m + image.offset_m,
    )


@compiled
def states_of(image: RangeImage, xyz_m: F32, tolerance_m: float) -> I8:
    """Return (N,) UNSEEN, FREE or OCCUPIED: the `state_at` of each point (N, 3)."""
    states = np.empty(len(xyz_m), np.int8)
    for i in range(len(xyz_m)):
        x_m, y_m, z_m = np.float64(xyz_m[i, 0]), np.float64(xyz_m[i, 1]), np.float64(xyz_m[i, 2])
        states[i] = state_at(image, x_m, y_m, z_m, tolerance_m)
    return states


@compiled
def state_at(image: RangeImage, x_m: float, y_m: float, z_m: float, tolerance_m: float) -> int:
    """Return the state of a place: OCCUPIED if a ray around it returned within `tolerance_m`.

    FREE if all rays around it, in three columns of azimuth and the next filled rows, went on
    beyond it; UNSEEN otherwise.
    """
    turn, offset_m = image.rotation, image.offset_m
    row, column, range_m = _direction(
        turn[0, 0] * x_m + turn[0, 1] * y_m + turn[0, 2] * z_m + offset_m[0],
        turn[1, 0] * x_m + turn[1, 1] * y_m + turn[1, 2] * z_m + offset_m[1],
        turn[2, 0] * x_m + turn[2, 1] * y_m + turn[2, 2] * z_m + offset_m[2],
    )
    passed, neighbours = 0, 0
    for c in range(column - 1, column + 2):
        line_near = image.nearest_m[c % _COLUMNS]
        line_far = image.farthest_m[c % _COLUMNS]
        for step in (-1, 0, 1):
            r = row if step == 0 else _first_filled(line_near, row, step)
            if r < 0 or line_near[r] == 0:
                continue
            neighbours += 1
            if line_near[r] > range_m + tolerance_m:
                passed += 1
            elif line_far[r] > range_m - tolerance_m:
                return OCCUPIED
    return FREE if neighbours >= _MIN_NEIGHBOURS and passed == neighbours else UNSEEN


@compiled
def _direction(dx: float, dy: float, dz: float) -> _Direction:
    """Return the row, column and range of a place relative to the optical centre."""
    flat_m = np.sqrt(dx * dx + dy * dy) + 1e-6  # no division by zero on the axis
    column = int((fast_atan2(dy, dx) + np.pi) * (_COLUMNS / (2 * np.pi))) % _COLUMNS
    row = int(fast_atan2(dz, flat_m) * _ROWS_PER_RAD) + _ROWS // 2
    return _Direction(min(max(row, 0), _ROWS - 1), column, np.sqrt(flat_m * flat_m + dz * dz))


@compiled
def _fill_image(xyz_m: F32, origin_m: F64) -> tuple[F32, F32]:
    nearest_m = np.zeros((_COLUMNS, _ROWS), np.float32)
    farthest_m = np.zeros((_COLUMNS, _ROWS), np.float32)
    for i in range(len(xyz_m)):
        row, column, range_m = _direction(
            xyz_m[i, 0] - origin_m[0], xyz_m[i, 1] - origin_m[1], xyz_m[i, 2] - origin_m[2]
        )
        held_m = nearest_m[column, row]
        if held_m == 0 or range_m < held_m:
            nearest_m[column, row] = range_m
        farthest_m[column, row] = max(farthest_m[column, row], range_m)
    return nearest_m, farthest_m


@compiled
def _first_filled(line_m: F32, row: int, step: int) -> int:
    """Return the next row with a return, upwards or downwards; -1 beyond the widest gap."""
    for _ in range(_GAP_ROWS):
        row += step
        if row < 0 or row >= _ROWS:
            return -1
        if line_m[row] > 0:
            return row
    return -1
