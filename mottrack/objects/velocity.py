"""Velocity of each object from a flow field.

"The object level velocity is approximated by the mean flow vector of all the BeV grids within the
detected bounding box boundary" (section IV-D). For filtered grids "a weighted aggregation ... based
on the occupancy probability of the cell" (section V-B). The covariance is there that of the cells'
flows for PillarFlow, and for DOGMa "a weighted aggregation of the DOGMa's preexisting velocity
co-variance matrix per occupied cell": `covariance: printed`. There cells are drawn at random; here
all of them count, which a draw approximates.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64
from mottrack.core.errors import InputError
from mottrack.core.motion import FlowField, VelocityMeasurement
from mottrack.core.objects import Boxes, Objects, Tracks

SHORTEST_M = 1e-12
"""Length of an edge between equal corners, which is divided by."""
MANY_CELLS = 5
"""Cells whose spread says something by itself: two variances and a covariance take three."""


class VelocityConfig(StrictModel):
    """How the cells of an object are aggregated to one measurement."""

    rule: Literal["mean", "weighted"] = Field(
        "mean", description="valid cells count equally, or by their occupancy probability"
    )
    covariance: Literal["joint", "printed"] = Field(
        "joint",
        description="spread of the cells by their number plus their own covariance; or as in "
        "section V-B: their own alone of a source that filters over time, else the spread alone",
    )
    margin_m: float = Field(0.0, ge=0, description="boxes grow by this on each side")
    min_cells: int = Field(1, ge=1, description="objects with fewer valid cells have no velocity")
    correlated_cells: float = Field(
        4.0, ge=1, description="cells that share one error: errors of neighbours are correlated"
    )
    floor_mps: float = Field(0.1, gt=0, description="lower bound of the standard deviation")


def measure_velocity(
    field: FlowField,
    boxes: Boxes,
    config: VelocityConfig | None = None,
    *,
    filtered: bool = False,
) -> VelocityMeasurement:
    """Measure one velocity for each of N boxes in the ego frame of the field, in its axes.

    mean = sum w v / sum w over the occupied and valid cells whose centre is inside the footprint
    (the box, or the hull of a cluster);
    covariance = (spread of the cells) / (effective number) + (mean of the source's own
    covariance) + floor. The spread of few cells is drawn towards that of the other objects, and
    boxes without enough cells are masked.

    Args:
        field: flow, in the current ego frame.
        boxes: in the same frame.
        config: how cells are aggregated.
        filtered: whether the source filters over time, as DOGMa does; `covariance: printed` asks.

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
        _Cells(
            np.where(field.valid & field.occupied, weight, np.float32(0)),
            np.array(field.velocity_mps),
            np.array(field.covariance_m2ps2),
            grid.x_min_m,
            grid.y_min_m,
            grid.cell_m,
        ),
    )
    return _measurement(sums, config, filtered=filtered)


class _Cells(NamedTuple):
    """A flow field as compiled code reads it: writable arrays of one memory layout."""

    weight: F32
    """(H, W) 0 where the cell does not count."""
    velocity_mps: F32
    """(H, W, 2)."""
    covariance_m2ps2: F32
    """(H, W, 2, 2)."""
    x_min_m: float
    y_min_m: float
    cell_m: float


def _measurement(sums: F64, config: VelocityConfig, *, filtered: bool) -> VelocityMeasurement:
    """Make the measurement from the sums (N, 11) of `_sums`."""
    total = np.where(sums[:, 0] > 0, sums[:, 0], 1.0)
    mean = sums[:, 2:4] / total[:, None]
    second = _symmetric(sums[:, 4:7] / total[:, None])
    spread = second - mean[:, :, None] * mean[:, None, :]
    own = _symmetric(sums[:, 7:10] / total[:, None])
    cells = sums[:, 0] ** 2 / np.where(sums[:, 1] > 0, sums[:, 1], 1.0)
    effective = np.maximum(cells / config.correlated_cells, 1.0)
    floor = config.floor_mps**2 * np.eye(2)
    shrunk = _shrunk(spread, sums[:, 10], config)
    covariance = shrunk / effective[:, None, None] + own + floor
    if config.covariance == "printed":
        covariance = (own if filtered else spread) + floor
    return VelocityMeasurement(mean, covariance, sums[:, 10] >= config.min_cells)


def _shrunk(spread: F64, cells: F64, config: VelocityConfig) -> F64:
    """Return the spread (N, 2, 2) of the cells of each object, which `cells` (N,) of them estimate.

    That of one cell is nothing and that of two is of one direction, so it is drawn towards what is
    usual: the median over the objects of enough cells, with the weight of `correlated_cells`.
    """
    many = cells >= MANY_CELLS
    if not many.any():
        return spread
    freedom = np.maximum(cells - 1.0, 0.0)
    own = 0.5 * np.trace(spread, axis1=1, axis2=2)[many] * cells[many] / freedom[many]
    usual, weight = float(np.median(own)), config.correlated_cells
    total = cells[:, None, None] * spread + weight * usual * np.eye(2)
    shrunk: F64 = total / (freedom + weight)[:, None, None]
    return shrunk


def _symmetric(entries: F64) -> F64:
    xx, xy, yy = entries.T
    return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)


@compiled
def _sums(edges: F64, start: I64, cells: _Cells) -> F64:
    """Sum velocities v and covariances C, weighted by w, over the cells inside each footprint.

    Returns (N, 11): w, w^2, w v (x, y), w v v^T (xx, xy, yy), w C (xx, xy, yy), number of cells.
    `edges` and `start` are those of `footprints`.
    """
    weight, velocity_mps, covariance_m2ps2 = (
        cells.weight,
        cells.velocity_mps,
        cells.covariance_m2ps2,
    )
    x_min_m, y_min_m, cell_m = cells.x_min_m, cells.y_min_m, cells.cell_m
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


def footprints(boxes: Boxes, margin_m: float, cell_m: float) -> tuple[F64, I64]:
    """Return the edges of N convex footprints, and the first edge of each (N + 1,).

    A footprint is the ground area of a box, or the hull of a cluster, grown by `margin_m`. A row
    (7,) of the edges: outward normal (x, y) and offset, where a point p is inside if
    `normal @ p <= offset` for all edges; then the footprint's bounds (low x, high x, low y,
    high y). A box thinner than a cell still covers the cells along its axis; a hull grows by half
    a cell, since its corners are points, not cells. A hull may be clockwise or not; one with fewer
    than three corners is replaced by the box.
    """
    hull = boxes.hull if isinstance(boxes, Objects | Tracks) else None
    if hull is None:
        return _edges(_box_corners(boxes, margin_m, cell_m), np.arange(len(boxes) + 1) * 4, 0.0)
    if any(len(corners) < 3 for corners in hull):
        box = _box_corners(boxes, 0.0, 0.0).reshape(-1, 4, 2)
        hull = tuple(h if len(h) >= 3 else b for h, b in zip(hull, box, strict=True))
    start = np.concatenate([[0], np.cumsum([len(corners) for corners in hull])]).astype(np.int64)
    corners = np.concatenate(hull) if hull else np.zeros((0, 2))
    return _edges(corners, start, margin_m + cell_m / 2)


def _box_corners(boxes: Boxes, margin_m: float, cell_m: float) -> F64:
    """Return (4 N, 2) corners, counter-clockwise, box after box."""
    half_m = np.maximum(boxes.size_m[:, :2] / 2 + margin_m, cell_m / np.sqrt(2))
    along = half_m[:, :1] * np.array([1.0, -1.0, -1.0, 1.0])
    across = half_m[:, 1:] * np.array([1.0, 1.0, -1.0, -1.0])
    cos, sin = np.cos(boxes.yaw_rad)[:, None], np.sin(boxes.yaw_rad)[:, None]
    x = boxes.centre_m[:, :1] + along * cos - across * sin
    y = boxes.centre_m[:, 1:2] + along * sin + across * cos
    return np.stack([x, y], axis=2).reshape(-1, 2)


def _edges(corners: F64, start: I64, grow_m: float) -> tuple[F64, I64]:
    following = np.arange(1, len(corners) + 1)
    following[start[1:] - 1] = start[:-1]
    side = corners[following] - corners
    length = np.maximum(np.hypot(side[:, 0], side[:, 1]), SHORTEST_M)
    normal = np.stack([side[:, 1], -side[:, 0]], axis=1) / length[:, None]
    owner = np.repeat(np.arange(len(start) - 1), np.diff(start))
    if len(corners):
        about = corners - corners[start[:-1]][owner]
        area = np.add.reduceat(about[:, 0] * side[:, 1] - about[:, 1] * side[:, 0], start[:-1])
        normal[(area < 0.0)[owner]] *= -1.0
    offset = np.einsum("ei,ei->e", normal, corners) + grow_m
    bounds = np.zeros((len(start) - 1, 4))
    if len(corners):
        for axis in (0, 1):
            bounds[:, 2 * axis] = np.minimum.reduceat(corners[:, axis], start[:-1]) - grow_m
            bounds[:, 2 * axis + 1] = np.maximum.reduceat(corners[:, axis], start[:-1]) + grow_m
    return np.column_stack([normal, offset, bounds[owner]]), start
