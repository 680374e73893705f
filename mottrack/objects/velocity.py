"""From a flow field to one velocity for each object.

"The object level velocity is approximated by the mean flow vector of all the BeV grids within the
detected bounding box boundary" (section IV-D). For filtered grids "a weighted aggregation ... based
on the occupancy probability of the cell" (section V-B).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64
from mottrack.core.errors import InputError
from mottrack.core.motion import FlowField, VelocityMeasurement
from mottrack.core.objects import Boxes
from mottrack.objects.footprints import footprints


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

    mean = sum w v / sum w over the occupied and valid cells whose centre is inside the footprint
    (the box, or the hull of a cluster);
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
        *footprints(boxes, config.margin_m, grid.cell_m),
        (
            np.where(field.valid & field.occupied, weight, np.float32(0)),
            np.array(field.velocity_mps),
            np.array(field.covariance_m2ps2),
        ),
        (grid.x_min_m, grid.y_min_m, grid.cell_m),
    )
    return _measurement(sums, config)


def _measurement(sums: F64, config: VelocityConfig) -> VelocityMeasurement:
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


def _symmetric(entries: F64) -> F64:
    xx, xy, yy = entries.T
    return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)


@compiled
def _sums(
    edges: F64,
    start: I64,
    cells: tuple[F32, F32, F32],
    extent: tuple[float, float, float],
) -> F64:
    """Weighted sums of velocity and covariance over the cells inside each footprint.

    `cells` are weight, velocity and covariance of the grid; see `footprints` for the first two.
    """
    weight, velocity_mps, covariance_m2ps2 = cells
    x_min_m, y_min_m, cell_m = extent
    rows, cols = weight.shape
    sums = np.zeros((len(start) - 1, 11))
    for b in range(len(start) - 1):
        first, last = start[b], start[b + 1]
        low_x, high_x, low_y, high_y = edges[first, 3:]
        row_low = max(int((low_y - y_min_m) // cell_m), 0)
        row_high = min(int((high_y - y_min_m) // cell_m), rows - 1)
        col_low = max(int((low_x - x_min_m) // cell_m), 0)
        col_high = min(int((high_x - x_min_m) // cell_m), cols - 1)
        for row in range(row_low, row_high + 1):
            y = y_min_m + (row + 0.5) * cell_m
            for col in range(col_low, col_high + 1):
                w = weight[row, col]
                if w > 0 and _inside(edges, first, last, x_min_m + (col + 0.5) * cell_m, y):
                    vx, vy = velocity_mps[row, col, 0], velocity_mps[row, col, 1]
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


@compiled
def _inside(edges: F64, first: int, last: int, x: float, y: float) -> bool:
    outside_m = -np.inf
    for e in range(first, last):
        outside_m = max(outside_m, edges[e, 0] * x + edges[e, 1] * y - edges[e, 2])
    return outside_m <= 0.0
