"""Point-in-box queries for rotated boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.checks import as_array
from mottrack.core.objects import Boxes
from mottrack.core.pose import rotation_2d
from mottrack.lidar.point_grid import PointGrid, build_point_grid, cells_within

_CELL_M = 2.0
"""About the width of a car: few cells per box, and few points beside it in them."""
_MAX_CELLS = 200_000.0
"""Bounds the memory of the grid (1.6 MB) where points are far away; cells then grow."""


@dataclass(frozen=True, slots=True)
class PointsInBoxes:
    """Points of each of B boxes: `index[start[b]:start[b + 1]]` are those of box `b`, ascending."""

    index: I64
    """Point indices sorted by box; a point in two boxes appears twice."""
    start: I64
    """(B + 1,) first entry of each box."""

    def of(self, box: int) -> I64:
        """Return the indices of the points in one box."""
        return self.index[self.start[box] : self.start[box + 1]]

    def first_box(self, num_points: int) -> I64:
        """Return (N,) the first box that holds each point, -1 where none does."""
        box_of = np.full(num_points, -1, np.int64)
        boxes = np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))
        box_of[self.index[::-1]] = boxes[::-1]
        return box_of


def near_boxes(xy_m: F64, boxes: Boxes, reach_m: float) -> Mask:
    """Return (N,) whether places (N, 2) lie in one of the boxes or within `reach_m` of it.

    Seen from above; places and boxes in one frame.
    """
    near = np.zeros(len(xy_m), np.bool_)
    for centre_m, size_m, yaw_rad in zip(boxes.centre_m, boxes.size_m, boxes.yaw_rad, strict=True):
        local_m = np.abs((xy_m - centre_m[:2]) @ rotation_2d(float(yaw_rad)))
        outside_m = np.maximum(local_m - size_m[:2] / 2, 0.0)
        near |= np.hypot(outside_m[:, 0], outside_m[:, 1]) < reach_m
    return near


def points_in_boxes(
    xyz_m: ArrayLike,
    centre_m: ArrayLike,
    size_m: ArrayLike,
    yaw_rad: ArrayLike,
    margin_m: float = 0.0,
) -> PointsInBoxes:
    """Find the points (N, 3) in boxes of centre (B, 3), size l, w, h (B, 3) and yaw (B,).

    All in one frame. `margin_m` extends every side. Points are converted to float32: use a frame
    whose origin is near, such as the ego frame.

    Raises:
        InputError: a shape is wrong, or the numbers of centres, sizes and yaws differ.
    """
    boxes = _boxes(centre_m, size_m, yaw_rad, margin_m)
    points = as_array("xyz_m", xyz_m, np.float32, (None, 3))
    if len(points) == 0 or len(boxes) == 0:
        return PointsInBoxes(np.zeros(0, np.int64), np.zeros(len(boxes) + 1, np.int64))
    reach_m = float(np.max(np.abs(points[:, :2]))) + 1e-3  # the outermost points lie inside
    cell_m = max(_CELL_M, 2 * reach_m / np.sqrt(_MAX_CELLS))
    return PointsInBoxes(*_search(build_point_grid(points, cell_m, reach_m), boxes))


def _boxes(centre_m: ArrayLike, size_m: ArrayLike, yaw_rad: ArrayLike, margin_m: float) -> F64:
    """Return rows (8,) of centre, half sizes, cosine and sine of the yaw."""
    yaw = as_array("yaw_rad", yaw_rad, np.float64, (None,))
    centre = as_array("centre_m", centre_m, np.float64, (len(yaw), 3))
    half_m = as_array("size_m", size_m, np.float64, (len(yaw), 3)) / 2 + margin_m
    return np.column_stack([centre, half_m, np.cos(yaw), np.sin(yaw)])


@compiled
def _search(grid: PointGrid, boxes: F64) -> tuple[I64, I64]:
    start = np.zeros(len(boxes) + 1, np.int64)
    found = np.empty(len(grid.order) + 16, np.int64)  # grown where boxes overlap
    count = 0
    for b in range(len(boxes)):
        first = count
        reach_x = boxes[b, 3] * abs(boxes[b, 6]) + boxes[b, 4] * abs(boxes[b, 7])
        reach_y = boxes[b, 3] * abs(boxes[b, 7]) + boxes[b, 4] * abs(boxes[b, 6])
        x_m, y_m = boxes[b, 0], boxes[b, 1]
        col_low, col_high, row_low, row_high = cells_within(
            grid, x_m - reach_x, x_m + reach_x, y_m - reach_y, y_m + reach_y
        )
        if col_low <= col_high:
            for row in range(row_low, row_high + 1):
                low = grid.start[row * grid.cols + col_low]
                high = grid.start[row * grid.cols + col_high + 1]
                if count + high - low > len(found):
                    grown = np.empty(2 * (count + high - low), np.int64)
                    for i in range(count):
                        grown[i] = found[i]
                    found = grown
                count = _collect(grid, boxes[b], (low, high), found, count)
        found[first:count].sort()
        start[b + 1] = count
    return found[:count].copy(), start


@compiled
def _collect(grid: PointGrid, box: F64, span: tuple[int, int], found: I64, count: int) -> int:
    """Append the points of a span of the grid that lie in the box; return the new count."""
    for k in range(span[0], span[1]):
        dx = grid.xyz_m[k, 0] - box[0]
        dy = grid.xyz_m[k, 1] - box[1]
        along = abs(dx * box[6] + dy * box[7])
        across = abs(dy * box[6] - dx * box[7])
        if along <= box[3] and across <= box[4] and abs(grid.xyz_m[k, 2] - box[2]) <= box[5]:
            found[count] = grid.order[k]
            count += 1
    return count
