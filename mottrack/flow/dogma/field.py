"""From the world-aligned map to the flow field of the current ego frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.pose import rotation_2d
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
    silence_static: bool = Field(False, description="report zero for cells that are not moving")


class ObstaclePoints(NamedTuple):
    """The same M obstacle points in both frames, on the plane."""

    ego_m: NDArray[np.float32]
    """(M, 2) in the current ego frame."""
    window_m: NDArray[np.float32]
    """(M, 2) along the world's axes, from the window's corner."""


class View(NamedTuple):
    """The ego frame that the field is wanted in."""

    grid: BevGrid
    yaw_rad: float
    """Heading of the ego frame in the world."""
    stamp_ns: int


def is_moving(grid_map: GridMap, config: ReadoutConfig) -> NDArray[np.bool_]:
    """(rows, cols) occupied cells whose velocity v, with covariance S, differs from zero.

    The Mahalanobis test v^T S^-1 v > threshold: 9.2 is exceeded by one in a hundred at rest.
    """
    vx, vy = np.moveaxis(grid_map.moments.velocity_mps, -1, 0)
    xx, xy, yy = _covariance(grid_map, config)
    distance = (yy * vx * vx - 2 * xy * vx * vy + xx * vy * vy) / (xx * yy - xy * xy)
    moving: NDArray[np.bool_] = (distance > config.moving) & _measured(grid_map, config)
    return moving


def flow_field(
    grid_map: GridMap, points: ObstaclePoints, view: View, config: ReadoutConfig
) -> FlowField:
    """Every cell of the ego grid takes the mean of the map cells in which its points lie.

    Only cells with a current obstacle point are occupied. A cell is valid if one of its points
    lies in a map cell with enough occupied and persistent mass; its covariance is that of the
    mixture of those map cells. Means and covariances are turned into ego axes.
    """
    grid = view.grid
    occupied = grid.occupancy(points.ego_m)
    ego_cell, map_cell = _pair_cells(grid_map, points, grid)
    terms = _terms(grid_map, config)
    sums = [np.bincount(ego_cell, term[map_cell], grid.shape[0] * grid.shape[1]) for term in terms]
    number, mass, measured, *powers = (s.reshape(grid.shape) for s in sums)
    valid = measured > 0
    vx, vy, xx, xy, yy = (p / np.maximum(measured, 1) for p in powers)
    mean = np.stack([vx, vy], axis=-1)
    second = np.stack([xx, xy, xy, yy], axis=-1).reshape(*grid.shape, 2, 2)
    covariance = second - mean[..., :, None] * mean[..., None, :]
    turn = rotation_2d(-view.yaw_rad)
    return FlowField(
        grid=grid,
        velocity_mps=(mean @ turn.T).astype(np.float32),
        covariance_m2ps2=(turn @ covariance @ turn.T).astype(np.float32),
        occupied=occupied,
        valid=valid,
        weight=(mass / np.maximum(number, 1)).astype(np.float32),
        stamp_ns=view.stamp_ns,
    )


def _pair_cells(
    grid_map: GridMap, points: ObstaclePoints, grid: BevGrid
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Flat ego cell and flat map cell of every point that lies in both grids."""
    window = grid_map.window
    row, col, in_ego = grid.cells(points.ego_m)
    map_col, map_row = np.floor(points.window_m / window.cell_m).astype(np.int64).T
    in_map = (map_row >= 0) & (map_row < window.rows) & (map_col >= 0) & (map_col < window.cols)
    both = in_ego & in_map
    return (row * grid.shape[1] + col)[both], (map_row * window.cols + map_col)[both]


def _terms(grid_map: GridMap, config: ReadoutConfig) -> list[NDArray[np.float64]]:
    """What is summed over points: 1, m_occ, measured, and the first and second moments."""
    xx, xy, yy = _covariance(grid_map, config)
    measured = _measured(grid_map, config)
    reported = is_moving(grid_map, config) if config.silence_static else measured
    vx, vy = np.moveaxis(grid_map.moments.velocity_mps * reported[..., None], -1, 0)
    moments = (vx, vy, xx + vx * vx, xy + vx * vy, yy + vy * vy)
    one = np.ones(measured.shape)
    terms = (one, grid_map.masses.occupied, measured, *(measured * m for m in moments))
    return [np.asarray(term, np.float64).ravel() for term in terms]


def _measured(grid_map: GridMap, config: ReadoutConfig) -> NDArray[np.bool_]:
    """Cells whose velocity means something."""
    occupied = grid_map.masses.occupied
    persistent = grid_map.split.persistent
    enough: NDArray[np.bool_] = occupied >= config.occupied
    return enough & (persistent > 0) & (persistent >= np.float32(config.persistent) * occupied)


def _covariance(
    grid_map: GridMap, config: ReadoutConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Variance along x, covariance and variance along y, positive definite."""
    xx, xy, yy = np.moveaxis(grid_map.moments.covariance_m2ps2.astype(np.float64), -1, 0)
    floor = config.least_deviation_mps**2
    return xx + floor, xy, yy + floor
