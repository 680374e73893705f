"""A 2.5-D height map of the ground, estimated sweep by sweep (paper, section V-A).

Each cell of a grid fixed to the world remembers the lowest level at which it was ever hit reliably,
so ground that a vehicle covers now is known from before or after. From these levels a surface is
fitted: a lower envelope whose slope is limited separates what may be ground from bodies, crowns and
bridges, then a local plane is fitted around every cell with weights that forget whatever stands
above it (robust interpolation after Kraus and Pfeifer, 1998). Only past sweeps are used. Nothing is
assumed about the height of the ego frame's origin over the road.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64
from mottrack.core.errors import InputError
from mottrack.core.sweep import Sweep
from mottrack.core.timing import timed
from mottrack.lidar.terrain_fit import above, envelope, interpolated, lowest, pits, planes, remember


class TerrainConfig(StrictModel):
    """Parameters of `Terrain`."""

    reach_m: float = Field(64.0, gt=0, le=500, description="half side of the map around the ego")
    cell_m: float = Field(1.0, gt=0, le=10, description="side of a cell")
    max_slope: float = Field(0.2, gt=0, description="steepest ground, rise over run")
    band_m: float = Field(0.12, gt=0, description="residual at which a cell's weight is a half")
    window_cells: int = Field(4, ge=1, le=50, description="half width of the local plane fit")
    rounds: int = Field(2, ge=1, le=20, description="re-weightings per sweep")
    memory: float = Field(10.0, ge=1, description="sweeps over which a cell's level is averaged")


class Terrain:
    """The height map; `update` with every sweep in turn, then ask for heights."""

    Config = TerrainConfig

    def __init__(self, config: TerrainConfig | None = None) -> None:
        self.config = config or TerrainConfig()
        self._cells = int(np.ceil(2 * self.config.reach_m / self.config.cell_m))
        self.reset()

    def reset(self) -> None:
        """Forgets everything: a new scene begins."""
        shape = (self._cells, self._cells)
        self._level_m = np.full(shape, np.nan)
        self._seen = np.zeros(shape)
        self._corner = np.zeros(2, np.int64)
        self._surface_m: F64 | None = None

    @timed("ground")
    def update(self, sweep: Sweep) -> None:
        """Takes in one sweep; its pose must be in the same world frame as those before."""
        pose = sweep.world_T_ego
        centre = np.floor(pose.translation_m[:2] / self.config.cell_m).astype(np.int64)
        self._move_to(centre - self._cells // 2)
        origin_m = self._corner * self.config.cell_m
        rotation, offset_m = pose.rotation, pose.translation_m - np.append(origin_m, 0.0)
        low_m = lowest(sweep.xyz_m, rotation, offset_m, self._cells, self.config.cell_m)
        remember(self._level_m, self._seen, low_m, self.config.band_m, self.config.memory)
        self._surface_m = self._fit()

    def height_m(self, xy_m: F64) -> F64:
        """(N,) height of the ground at (N, 2) world positions; beyond the map that of its edge.

        Raises:
            InputError: there was no sweep yet.
        """
        if self._surface_m is None:
            raise InputError("sweeps seen", 0, "at least one call of update")
        local_m = np.asarray(xy_m, np.float64) - self._corner * self.config.cell_m
        heights: F64 = interpolated(self._surface_m, local_m, self.config.cell_m)
        return heights

    def height_above_m(self, sweep: Sweep) -> F64:
        """(N,) height of each point of a sweep above the ground below it.

        Raises:
            InputError: there was no sweep yet.
        """
        if self._surface_m is None:
            raise InputError("sweeps seen", 0, "at least one call of update")
        pose, corner_m = sweep.world_T_ego, self._corner * self.config.cell_m
        offset_m = pose.translation_m - np.append(corner_m, 0.0)
        cell_m = self.config.cell_m
        heights: F64 = above(sweep.xyz_m, pose.rotation, offset_m, self._surface_m, cell_m)
        return heights

    def _move_to(self, corner: I64) -> None:
        """Shifts the map by whole cells, forgetting what leaves it."""
        shift = corner - self._corner
        self._corner = corner
        if not shift.any():
            return
        level_m = np.full_like(self._level_m, np.nan)
        seen = np.zeros_like(self._seen)
        if np.abs(shift).max() < self._cells:
            to, source = _overlap(int(shift[1]), self._cells), _overlap(-int(shift[1]), self._cells)
            to_x, from_x = (
                _overlap(int(shift[0]), self._cells),
                _overlap(-int(shift[0]), self._cells),
            )
            level_m[to, to_x] = self._level_m[source, from_x]
            seen[to, to_x] = self._seen[source, from_x]
        self._level_m, self._seen = level_m, seen

    def _fit(self) -> F64:
        """(C, C) heights of the ground at the cells' centres."""
        known = np.isfinite(self._level_m)
        if not known.any():
            return np.zeros_like(self._level_m)
        config = self.config
        rise_m = config.max_slope * config.cell_m
        level_m = np.where(known & ~pits(self._level_m, rise_m), self._level_m, np.nan)
        surface_m = envelope(level_m, rise_m)
        for _ in range(config.rounds):
            surface_m = planes(level_m, surface_m, config.band_m, config.window_cells)
        return np.asarray(surface_m, np.float64)


def _overlap(shift: int, cells: int) -> slice:
    """Rows of the shifted map that the old one covers."""
    return slice(max(-shift, 0), cells - max(shift, 0))
