"""Recursive 2.5-D height map of the ground (paper, section V-A).

Each cell of a world-aligned grid stores the lowest level at which it was reliably hit, so ground
that a vehicle covers now is known from earlier sweeps. A surface is fitted to these levels: a
slope-limited lower envelope separates ground from objects, tree crowns and bridges, then a plane is
fitted around every cell with weights that suppress whatever stands above it (robust interpolation
after Kraus and Pfeifer, 1998). Only past sweeps are used. Nothing is assumed about the height of
the ego frame's origin over the road.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F64
from mottrack.core.errors import InputError
from mottrack.core.sweep import Sweep
from mottrack.core.timing import timed
from mottrack.lidar.scrolling import scrolled
from mottrack.lidar.terrain_fit import (
    heights_above,
    lower_envelope,
    lowest_levels,
    merge_levels,
    pits,
    planes,
)


class TerrainConfig(StrictModel):
    """Settings of `Terrain`."""

    reach_m: float = Field(64.0, gt=0, le=500, description="half side of the map around the ego")
    cell_m: float = Field(1.0, gt=0, le=10, description="side of a cell")
    max_slope: float = Field(0.2, gt=0, description="steepest ground, rise over run")
    band_m: float = Field(0.12, gt=0, description="residual at which a cell's weight is a half")
    window_cells: int = Field(4, ge=1, le=50, description="half width of the local plane fit")
    rounds: int = Field(2, ge=1, le=20, description="re-weightings per sweep")
    memory: float = Field(10.0, ge=1, description="sweeps over which a cell's level is averaged")


class Terrain:
    """Height map of the ground; call `update` with every sweep, then `height_above_m`."""

    def __init__(self, config: TerrainConfig | None = None) -> None:
        self.config = config or TerrainConfig()
        self._cells = int(np.ceil(2 * self.config.reach_m / self.config.cell_m))
        self.reset()

    def reset(self) -> None:
        """Clear the map at the start of a scene."""
        shape = (self._cells, self._cells)
        self._level_m: F64 = np.full(shape, np.nan)
        self._support: F64 = np.zeros(shape)
        self._corner = np.zeros(2, np.int64)
        self._surface_m: F64 | None = None

    @timed("ground")
    def update(self, sweep: Sweep) -> None:
        """Integrate one sweep; its pose must be in the same world frame as those before."""
        config, pose = self.config, sweep.world_T_ego
        centre = np.floor(pose.translation_m[:2] / config.cell_m).astype(np.int64)
        corner = centre - self._cells // 2
        columns, rows = (corner - self._corner).tolist()
        self._corner = corner
        self._level_m = scrolled(self._level_m, (rows, columns), np.nan)
        self._support = scrolled(self._support, (rows, columns))
        offset_m = self._offset_m(sweep)
        low_m = lowest_levels(sweep.xyz_m, pose.rotation, offset_m, self._cells, config.cell_m)
        merge_levels(self._level_m, self._support, low_m, config.band_m, config.memory)
        self._surface_m = self._fit()

    def height_above_m(self, sweep: Sweep) -> F64:
        """Return (N,) the height of each point above the ground; beyond the map that of its edge.

        Raises:
            InputError: there was no sweep yet.
        """
        if self._surface_m is None:
            raise InputError("sweeps seen", 0, "at least one call of update")
        rotation, offset_m = sweep.world_T_ego.rotation, self._offset_m(sweep)
        return heights_above(sweep.xyz_m, rotation, offset_m, self._surface_m, self.config.cell_m)

    def _offset_m(self, sweep: Sweep) -> F64:
        """Return (3,) the ego origin, relative to the lower left corner of the map."""
        corner_m: F64 = np.append(self._corner * self.config.cell_m, 0.0)
        return sweep.world_T_ego.translation_m - corner_m

    def _fit(self) -> F64:
        """Return (C, C) heights of the ground at the cells' centres."""
        known = np.isfinite(self._level_m)
        if not known.any():
            return np.zeros_like(self._level_m)
        config = self.config
        rise_m = config.max_slope * config.cell_m
        level_m = np.where(known & ~pits(self._level_m, rise_m), self._level_m, np.nan)
        surface_m: F64 = lower_envelope(level_m, rise_m)
        for _ in range(config.rounds):
            surface_m = planes(level_m, surface_m, config.band_m, config.window_cells)
        return surface_m
