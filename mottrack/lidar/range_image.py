"""Which points another sweep looked through, did not look at, or could not see.

A return says that its ray was free up to there. A point in front of the returns of its
neighbouring rays, above and below, stands where that sweep saw free space; a point behind one of
them may have been hidden from it. This is the polar raster of `visibility` with elevation, so that
what a ray passes over is not taken for free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I8
from mottrack.core.pose import Pose
from mottrack.lidar.azimuth import quick_atan2

HIDDEN, PASSED, HIT = 0, 1, 2
_COLUMNS = 900
"""0.4 degrees: at least one ray of any rotating LiDAR in each column."""
_ROWS_PER_RAD = 229.18
"""0.25 degrees: no two rays of a 128-ring sensor far apart in one row."""
_ROWS = 480
"""120 degrees about the horizon."""
_GAP_ROWS = 8
"""2 degrees: the widest gap between neighbouring rings."""


class RangeImage(NamedTuple):
    """Nearest and farthest return per direction from the optical centre; 0 where none."""

    nearest_m: F32
    farthest_m: F32
    rotation: F64
    """(3, 3) turns a place that is asked for into the frame of the sweep."""
    offset_m: F64
    """(3,) is added to it then: it is relative to the optical centre."""


def build_range_image(xyz_m: F32, origin_m: F64) -> RangeImage:
    """Range image of all returns (N, 3), ground included, around the optical centre (3,)."""
    origin = np.array(origin_m, dtype=np.float64)
    nearest_m, farthest_m = _fill(np.array(xyz_m), origin)
    return RangeImage(nearest_m, farthest_m, np.eye(3), -origin)


def asked_from(image: RangeImage, sweep_T_frame: Pose) -> RangeImage:
    """The same image, asked for places in another frame: the returns stay where they are."""
    return image._replace(
        rotation=np.ascontiguousarray(sweep_T_frame.rotation),
        offset_m=sweep_T_frame.translation_m + image.offset_m,
    )


def seen_before(image: RangeImage, xyz_m: F32, slack_m: float = 0.5) -> I8:
    """(N,) HIDDEN, PASSED (rays went on beyond it) or HIT (returns at its range), of each point."""
    return np.asarray(_states(image, np.array(xyz_m), slack_m))


@compiled
def _bin(dx: float, dy: float, dz: float) -> tuple[int, int, float]:
    """Row, column and range of a place relative to the optical centre."""
    flat_m = np.sqrt(dx * dx + dy * dy) + 1e-6
    column = int((quick_atan2(dy, dx) + np.pi) * (_COLUMNS / (2 * np.pi))) % _COLUMNS
    row = int(quick_atan2(dz, flat_m) * _ROWS_PER_RAD) + _ROWS // 2
    return min(max(row, 0), _ROWS - 1), column, np.sqrt(flat_m * flat_m + dz * dz)


@compiled
def _fill(xyz_m: F32, origin_m: F64) -> tuple[F32, F32]:
    nearest_m = np.zeros((_COLUMNS, _ROWS), np.float32)
    farthest_m = np.zeros((_COLUMNS, _ROWS), np.float32)
    for i in range(len(xyz_m)):
        row, column, range_m = _bin(
            xyz_m[i, 0] - origin_m[0], xyz_m[i, 1] - origin_m[1], xyz_m[i, 2] - origin_m[2]
        )
        held_m = nearest_m[column, row]
        if held_m == 0 or range_m < held_m:
            nearest_m[column, row] = range_m
        farthest_m[column, row] = max(farthest_m[column, row], range_m)
    return nearest_m, farthest_m


@compiled
def _first_filled(line_m: F32, row: int, step: int) -> int:
    for _ in range(_GAP_ROWS):
        row += step
        if row < 0 or row >= _ROWS:
            return -1
        if line_m[row] > 0:
            return row
    return -1


@compiled
def state_at(image: RangeImage, x_m: float, y_m: float, z_m: float, slack_m: float) -> int:
    """HIDDEN, PASSED or HIT at one place; a neighbourhood of three columns decides."""
    turn, offset_m = image.rotation, image.offset_m
    row, column, range_m = _bin(
        turn[0, 0] * x_m + turn[0, 1] * y_m + turn[0, 2] * z_m + offset_m[0],
        turn[1, 0] * x_m + turn[1, 1] * y_m + turn[1, 2] * z_m + offset_m[1],
        turn[2, 0] * x_m + turn[2, 1] * y_m + turn[2, 2] * z_m + offset_m[2],
    )
    passed, sides = 0, 0
    for c in range(column - 1, column + 2):
        line_near = image.nearest_m[c % _COLUMNS]
        line_far = image.farthest_m[c % _COLUMNS]
        for step in (-1, 0, 1):
            r = row if step == 0 else _first_filled(line_near, row, step)
            if r < 0 or line_near[r] == 0:
                continue
            sides += 1
            if line_near[r] > range_m + slack_m:
                passed += 1
            elif line_far[r] > range_m - slack_m:
                return HIT
    return PASSED if sides >= 4 and passed == sides else HIDDEN


@compiled
def _states(image: RangeImage, xyz_m: F32, slack_m: float) -> I8:
    states = np.empty(len(xyz_m), np.int8)
    for i in range(len(xyz_m)):
        states[i] = state_at(image, xyz_m[i, 0], xyz_m[i, 1], xyz_m[i, 2], slack_m)
    return states
