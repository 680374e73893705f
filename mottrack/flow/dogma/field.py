"""From the world-aligned map to the flow field of the current ego frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.pose import rotation_2d
from mottrack.core.sweep import Sweep
from mottrack.flow.dogma.filter import GridMap


class ReadoutConfig(StrictModel):
    """Which cells are given a velocity, and what counts as moving."""

    occupied: float = Field(0.6, ge=0, le=1, description="least occupied mass of a valid cell")
    persistent: float = Field(
        0.5, ge=0, le=1, description="least share of it seen before: a new cell has no velocity yet"
    )
    moving: float = Field(9.2, ge=0, description="squared Mahalanobis distance from rest")
    least_deviation_mps: float = Field(
        0.1, gt=0, description="joins the standard deviation of each axis: never certain"
    )
    relative: float = Field(
        0.4,
        ge=0,
        description="share of the speed that joins it where the velocity is reported: the few "
        "particles of a cell agree by chance, and its neighbours err alike",
    )
    zero_static: bool = Field(False, description="report zero for cells that are not moving")


class ObstaclePoints(NamedTuple):
    """The same M obstacle points in both frames, on the plane."""

    ego_m: F32
    """(M, 2) in the current ego frame."""
    window_m: F32
    """(M, 2) along the world's axes, from the window's corner."""


class _Cells(NamedTuple):
    """K cells of the map, in world axes."""

    occupied: F32
    """(K,) occupied mass."""
    measured: Mask
    """(K,) whether there is a velocity: enough mass, and enough of it persistent."""
    moving: Mask
    """(K,) measured cells at a Mahalanobis distance from rest."""
    velocity_mps: F64
    """(K, 2)."""
    covariance_m2ps2: F64
    """(K, 3) variance along x, covariance, variance along y, as reported; positive definite."""


def is_moving(grid_map: GridMap, config: ReadoutConfig) -> Mask:
    """Return (rows, cols) occupied cells whose velocity v, of covariance S, differs from zero.

    By the Mahalanobis test v^T S^-1 v > threshold: 9.2 is exceeded by 1 % of the cells at rest.
    """
    moving = np.zeros(grid_map.masses.occupied.size, np.bool_)
    candidates = np.flatnonzero(grid_map.masses.occupied >= config.occupied)
    moving[candidates] = _read(grid_map, candidates, config).moving
    return moving.reshape(grid_map.window.shape)


def flow_field(
    grid_map: GridMap, points: ObstaclePoints, grid: BevGrid, sweep: Sweep, config: ReadoutConfig
) -> FlowField:
    """Return the field: each cell of the ego grid is the mean of the map cells of its points.

    Only cells with a current obstacle point are occupied. A cell is valid if one of its points
    lies in a map cell with enough occupied and persistent mass; its covariance is that of the
    mixture of those map cells. Means and covariances are rotated into ego axes.
    """
    ego_cell, map_cell = _pair_cells(grid_map, points, grid)
    hit, slot = np.unique(ego_cell, return_inverse=True)
    terms = _terms(_read(grid_map, map_cell, config), config)
    sums = np.stack([np.bincount(slot, term, len(hit)) for term in terms], axis=-1)
    number, mass, measured = sums[:, :3].T
    powers = sums[:, 3:] / np.maximum(measured, 1)[:, None]
    mean = powers[:, :2]
    covariance = powers[:, [2, 3, 3, 4]].reshape(-1, 2, 2) - mean[:, :, None] * mean[:, None]
    turn = rotation_2d(-sweep.world_T_ego.yaw_rad)
    return FlowField(
        grid=grid,
        velocity_mps=_spread(mean @ turn.T, hit, grid),
        covariance_m2ps2=_spread(turn @ covariance @ turn.T, hit, grid),
        occupied=grid.occupancy(points.ego_m),
        valid=_spread(measured, hit, grid) > 0,
        weight=_spread(mass / number, hit, grid),
        stamp_ns=sweep.stamp_ns,
    )


def _pair_cells(grid_map: GridMap, points: ObstaclePoints, grid: BevGrid) -> tuple[I64, I64]:
    """Return flat ego cell and flat map cell of every point that lies in both grids."""
    window = grid_map.window
    row, col, in_ego = grid.cells(points.ego_m)
    map_col, map_row = np.floor(points.window_m / window.cell_m).astype(np.int64).T
    in_map = (map_row >= 0) & (map_row < window.rows) & (map_col >= 0) & (map_col < window.cols)
    both = in_ego & in_map
    return (row * grid.shape[1] + col)[both], (map_row * window.cols + map_col)[both]


def _read(grid_map: GridMap, cell: I64, config: ReadoutConfig) -> _Cells:
    """Return the map at flat cells (K,)."""
    occupied = grid_map.masses.occupied.ravel()[cell]
    persistent = grid_map.split.persistent.ravel()[cell]
    measured = (occupied >= config.occupied) & (persistent > 0)
    measured &= persistent >= np.float32(config.persistent) * occupied
    velocity = grid_map.moments.velocity_mps.reshape(-1, 2)[cell].astype(np.float64)
    covariance = grid_map.moments.covariance_m2ps2.reshape(-1, 3)[cell].astype(np.float64)
    covariance[:, [0, 2]] += config.least_deviation_mps**2
    (vx, vy), (xx, xy, yy) = velocity.T, covariance.T
    distance = (yy * vx * vx - 2 * xy * vx * vy + xx * vy * vy) / (xx * yy - xy * xy)
    moving = measured & (distance > config.moving)
    # after the test: against a spread that grows with the speed, no speed would differ from zero
    covariance[:, [0, 2]] += (config.relative**2 * (vx * vx + vy * vy))[:, None]
    return _Cells(occupied, measured, moving, velocity, covariance)


def _terms(cells: _Cells, config: ReadoutConfig) -> list[F64]:
    """Return the terms summed over points: 1, m_occ, measured, first and second moments."""
    reported = cells.moving if config.zero_static else cells.measured
    vx, vy = (cells.velocity_mps * reported[:, None]).T
    xx, xy, yy = cells.covariance_m2ps2.T * cells.measured
    moments = [vx, vy, xx + vx * vx, xy + vx * vy, yy + vy * vy]
    return [np.ones(len(vx)), cells.occupied.astype(float), cells.measured.astype(float), *moments]


def _spread(values: F64, cell: I64, grid: BevGrid) -> F32:
    """Return a grid (H, W, ...) with values (K, ...) at flat cells (K,), zero elsewhere."""
    height, width = grid.shape
    full = np.zeros((height * width, *values.shape[1:]), np.float32)
    full[cell] = values
    return full.reshape(height, width, *values.shape[1:])
