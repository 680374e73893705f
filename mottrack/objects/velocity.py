"""From a flow field to one velocity for each object.

"The object level velocity is approximated by the mean flow vector of all the BeV grids within the
detected bounding box boundary" (section IV-D). For filtered grids "a weighted aggregation ... based
on the occupancy probability of the cell" (section V-B).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.errors import InputError
from mottrack.core.motion import FlowField, VelocityMeasurement
from mottrack.core.objects import Boxes


class VelocityConfig(StrictModel):
    """How the cells of an object become one measurement."""

    rule: Literal["mean", "weighted"] = Field(
        "mean", description="every valid cell counts the same, or by its occupancy probability"
    )
    margin_m: float = Field(0.0, ge=0, description="boxes grow by this on each side")
    min_cells: int = Field(1, ge=1, description="fewer valid cells are no measurement")
    correlated_cells: float = Field(
        4.0, ge=1, description="cells that share one error: a source's errors are not independent"
    )
    floor_mps: float = Field(0.1, gt=0, description="least standard deviation")


def measure_velocity(
    field: FlowField, boxes: Boxes, config: VelocityConfig | None = None
) -> VelocityMeasurement:
    """One velocity for each of N boxes, which are in the ego frame of the field, in its axes.

    mean = sum w v / sum w over the occupied and valid cells whose centre is inside the box;
    covariance = (spread of the cells) / (effective number) + (mean of the source's own
    covariance) + floor. Boxes without enough such cells are masked.

    Raises:
        InputError: the boxes are not in the ego frame.
    """
    config = config or VelocityConfig()
    if boxes.frame != "ego":
        raise InputError("frame of boxes", repr(boxes.frame), "'ego'")
    weight = field.weight if config.rule == "weighted" else np.ones_like(field.weight)
    grid = field.grid
    sums = _sums(
        _footprints(boxes, config.margin_m, grid.cell_m),
        np.where(field.valid & field.occupied, weight, np.float32(0)),
        np.array(field.velocity_mps),
        np.array(field.covariance_m2ps2),
        (grid.x_min_m, grid.y_min_m, grid.cell_m),
    )
    return _measurement(sums, config)


def _footprints(boxes: Boxes, margin_m: float, cell_m: float) -> NDArray[np.float64]:
    """(N, 6) centre x, y, half length, half width, cosine and sine of the heading."""
    # a box thinner than a cell still owns the cells that its middle runs through
    half_m = np.maximum(boxes.size_m[:, :2] / 2 + margin_m, cell_m / np.sqrt(2))
    return np.column_stack(
        [boxes.centre_m[:, :2], half_m, np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad)]
    )


def _measurement(sums: NDArray[np.float64], config: VelocityConfig) -> VelocityMeasurement:
    """From sums per box (N, 11): w, w^2, w v, w v v^T (xx, xy, yy), w C (xx, xy, yy), cells."""
    total = np.where(sums[:, 0] > 0, sums[:, 0], 1.0)
    mean = sums[:, 2:4] / total[:, None]
    second = _symmetric(sums[:, 4:7] / total[:, None])
    spread = second - mean[:, :, None] * mean[:, None, :]
    own = _symmetric(sums[:, 7:10] / total[:, None])
    cells = sums[:, 0] ** 2 / np.where(sums[:, 1] > 0, sums[:, 1], 1.0)
    effective = np.maximum(cells / config.correlated_cells, 1.0)
    floor = config.floor_mps**2 * np.eye(2)
    covariance = spread / effective[:, None, None] + own + floor
    return VelocityMeasurement(mean, covariance, sums[:, 10] >= config.min_cells)


def _symmetric(entries: NDArray[np.float64]) -> NDArray[np.float64]:
    xx, xy, yy = entries.T
    return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)


@njit(cache=True)
def _sums(
    boxes: NDArray[np.float64],
    weight: NDArray[np.float32],
    velocity_mps: NDArray[np.float32],
    covariance_m2ps2: NDArray[np.float32],
    extent: tuple[float, float, float],
) -> NDArray[np.float64]:
    """Weighted sums of velocity and covariance over the cells inside each box."""
    x_min_m, y_min_m, cell_m = extent
    rows, cols = weight.shape
    sums = np.zeros((len(boxes), 11))
    for b in range(len(boxes)):
        x_m, y_m, half_length, half_width, cos, sin = boxes[b]
        reach_m = np.hypot(half_length, half_width)
        row_low = max(int((y_m - reach_m - y_min_m) // cell_m), 0)
        row_high = min(int((y_m + reach_m - y_min_m) // cell_m), rows - 1)
        col_low = max(int((x_m - reach_m - x_min_m) // cell_m), 0)
        col_high = min(int((x_m + reach_m - x_min_m) // cell_m), cols - 1)
        for row in range(row_low, row_high + 1):
            dy = y_min_m + (row + 0.5) * cell_m - y_m
            for col in range(col_low, col_high + 1):
                dx = x_min_m + (col + 0.5) * cell_m - x_m
                inside = abs(dx * cos + dy * sin) <= half_length
                inside &= abs(dy * cos - dx * sin) <= half_width
                if inside and weight[row, col] > 0:
                    w = weight[row, col]
                    vx, vy = velocity_mps[row, col]
                    sums[b, 0] += w
                    sums[b, 1] += w * w
                    sums[b, 2] += w * vx
                    sums[b, 3] += w * vy
                    sums[b, 4] += w * vx * vx
                    sums[b, 5] += w * vx * vy
                    sums[b, 6] += w * vy * vy
                    sums[b, 7] += w * covariance_m2ps2[row, col, 0, 0]
                    sums[b, 8] += w * covariance_m2ps2[row, col, 0, 1]
                    sums[b, 9] += w * covariance_m2ps2[row, col, 1, 1]
                    sums[b, 10] += 1
    return sums
