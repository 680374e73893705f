"""Recursive 2.5-D height map of the ground (paper, section V-A).

Each cell of a world-aligned grid stores the lowest level at which it was reliably hit, so ground
that a vehicle covers now is known from earlier sweeps. A surface is fitted to these levels: a
slope-limited lower envelope separates ground from objects, tree crowns and bridges, then a plane is
fitted around every cell with weights that suppress whatever stands above it (robust interpolation
after Kraus and Pfeifer, 1998). Only past sweeps are used. Nothing is assumed about the height of
the ego frame's origin over the road.

Arrays (C, C) are indexed [row, column], row along y, column along x; heights in metres, NaN where
a cell was never hit. `rotation` and `offset_m` transform points into the frame of the map, whose
origin is its lower left corner.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, Mask
from mottrack.core.errors import InputError
from mottrack.core.sweep import Sweep
from mottrack.core.timing import timed
from mottrack.lidar.scrolling import scrolled

_MIN_SUPPORT = 6.0
"""Sum of weights of a window below which it grows: twice what determines a plane."""
_MIN_WEIGHT = 0.05
"""Smaller weights are zero: objects are many, and together they would lift the surface."""
_SLOPE_PRIOR = 0.5
"""Added to the spread of x and y, in cells^2: a ridge penalty that keeps slopes of few or collinear
cells near zero and is negligible against a full window (half width 4: about 500)."""
_FORGETTING = 0.1
"""Support lost for each sweep that hits a cell only above its level."""
_PIT_DEPTH_M = 0.5
"""Least depth of a pit below all its neighbours; a kerb or a ditch is shallower."""
_BELOW = 3.0
"""How much farther below the surface than above it a level has half weight: ground is low."""


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
        low_m = _lowest_levels(sweep.xyz_m, pose.rotation, offset_m, self._cells, config.cell_m)
        _merge_levels(self._level_m, self._support, low_m, config.band_m, config.memory)
        self._surface_m = self._fit()

    def height_above_m(self, sweep: Sweep) -> F64:
        """Return (N,) the height of each point above the ground; beyond the map that of its edge.

        Raises:
            InputError: there was no sweep yet.
        """
        if self._surface_m is None:
            raise InputError("sweeps seen", 0, "at least one call of update")
        rotation, offset_m = sweep.world_T_ego.rotation, self._offset_m(sweep)
        return _heights_above(sweep.xyz_m, rotation, offset_m, self._surface_m, self.config.cell_m)

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
        level_m = np.where(known & ~_pits(self._level_m, rise_m), self._level_m, np.nan)
        surface_m: F64 = _lower_envelope(level_m, rise_m)
        for _ in range(config.rounds):
            surface_m = _planes(level_m, surface_m, config.band_m, config.window_cells)
        return surface_m


@compiled
def _lowest_levels(xyz_m: F32, rotation: F64, offset_m: F64, cells: int, cell_m: float) -> F64:
    """Return (C, C) the second lowest height in each cell; NaN with fewer than two points.

    The second lowest, because a single return from below the road, by reflection, is common.
    """
    first = np.full((cells, cells), np.inf)
    second = np.full((cells, cells), np.nan)
    for i in range(len(xyz_m)):
        x, y, z = xyz_m[i]
        east = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + offset_m[0]
        north = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + offset_m[1]
        column, row = int(np.floor(east / cell_m)), int(np.floor(north / cell_m))
        if 0 <= row < cells and 0 <= column < cells:
            height = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + offset_m[2]
            if height < first[row, column]:
                if first[row, column] < np.inf:
                    second[row, column] = first[row, column]
                first[row, column] = height
            elif not height >= second[row, column]:
                second[row, column] = height
    return second


@compiled
def _merge_levels(level_m: F64, support: F64, low_m: F64, band_m: float, memory: float) -> None:
    """Merge the levels `low_m` of a new sweep into the map, in place.

    A lower level replaces the old one (an object moved away), a level within the band is averaged
    in, a higher one (an object covers the ground) only reduces the support of the old one, so that
    a wrong low level is replaced after some sweeps.
    """
    for row in range(level_m.shape[0]):
        for column in range(level_m.shape[1]):
            low = low_m[row, column]
            if np.isnan(low):
                continue
            change = low - level_m[row, column]
            unsupported = change > band_m and support[row, column] <= 0.0
            if np.isnan(change) or change < -band_m or unsupported:
                level_m[row, column] = low
                support[row, column] = 1.0
            elif change > band_m:
                support[row, column] -= _FORGETTING
            else:
                support[row, column] = min(support[row, column] + 1.0, memory)
                level_m[row, column] += change / support[row, column]


@compiled
def _pits(level_m: F64, rise_m: float) -> Mask:
    """Return (C, C) cells far below all of at least three known neighbours (reflections)."""
    cells = level_m.shape[0]
    found = np.zeros(level_m.shape, np.bool_)
    depth_m = max(_PIT_DEPTH_M, 2.0 * rise_m)
    for row in range(cells):
        for column in range(cells):
            around, above_it = 0, 0
            for r in range(max(row - 1, 0), min(row + 2, cells)):
                for c in range(max(column - 1, 0), min(column + 2, cells)):
                    if (r != row or c != column) and not np.isnan(level_m[r, c]):
                        around += 1
                        above_it += level_m[r, c] - level_m[row, column] > depth_m
            found[row, column] = around >= 3 and above_it == around
    return found


@compiled
def _lower_envelope(level_m: F64, rise_m: float) -> F64:
    """Return the highest surface below all levels that rises by at most `rise_m` per cell.

    Computed by two chamfer passes.

    Infinite everywhere when no cell is known.
    """
    cells = level_m.shape[0]
    surface = np.where(np.isnan(level_m), np.inf, level_m)
    across = rise_m * np.sqrt(2.0)
    for k in range(2):
        step = 1 - 2 * k
        for i in range(cells):
            row = i if k == 0 else cells - 1 - i
            for j in range(cells):
                column = j if k == 0 else cells - 1 - j
                best = surface[row, column]
                if 0 <= column - step < cells:
                    best = min(best, surface[row, column - step] + rise_m)
                if 0 <= row - step < cells:
                    best = min(best, surface[row - step, column] + rise_m)
                    if column > 0:
                        best = min(best, surface[row - step, column - 1] + across)
                    if column < cells - 1:
                        best = min(best, surface[row - step, column + 1] + across)
                surface[row, column] = best
    return surface


@compiled
def _planes(level_m: F64, surface_m: F64, band_m: float, half: int) -> F64:
    """Return (C, C) heights at the cells of planes fitted around each by weighted least squares.

    A level has weight 1 on the old surface and a half at `band_m` above or three times that below
    it. A window with too little support grows, so unseen ground continues the ground around it.
    """
    sums = _moment_sums(level_m, surface_m, band_m)
    cells = level_m.shape[0]
    fitted = np.empty(level_m.shape)
    window = np.empty(9)
    for row in range(cells):
        for column in range(cells):
            reach = half
            _window_sums(sums, row, column, reach, window)
            while window[0] < _MIN_SUPPORT and reach < cells:
                reach *= 2
                _window_sums(sums, row, column, reach, window)
            fitted[row, column] = _plane_height(window, row + 0.5, column + 0.5)
    return fitted


@compiled
def _moment_sums(level_m: F64, surface_m: F64, band_m: float) -> F64:
    """Return (C + 1, C + 1, 9) integral images of w, wx, wy, wxx, wxy, wyy, wz, wxz, wyz."""
    cells = level_m.shape[0]
    sums = np.zeros((cells + 1, cells + 1, 9))
    line = np.empty(9)
    for row in range(cells):
        line[:] = 0.0
        y = row + 0.5
        for column in range(cells):
            z = level_m[row, column]
            if not np.isnan(z):
                off = z - surface_m[row, column]
                scaled = (off / (band_m if off >= 0 else _BELOW * band_m)) ** 2
                w = 1.0 / (1.0 + scaled * scaled)
                if w < _MIN_WEIGHT:
                    w = 0.0
                x = column + 0.5
                line[0] += w
                line[1] += w * x
                line[2] += w * y
                line[3] += w * x * x
                line[4] += w * x * y
                line[5] += w * y * y
                line[6] += w * z
                line[7] += w * x * z
                line[8] += w * y * z
            for m in range(9):
                sums[row + 1, column + 1, m] = sums[row, column + 1, m] + line[m]
    return sums


@compiled
def _window_sums(sums: F64, row: int, column: int, half: int, window: F64) -> None:
    cells = sums.shape[0] - 1
    top, bottom = min(row + half + 1, cells), max(row - half, 0)
    right, left = min(column + half + 1, cells), max(column - half, 0)
    for m in range(9):
        window[m] = sums[top, right, m] - sums[bottom, right, m]
        window[m] += sums[bottom, left, m] - sums[top, left, m]


@compiled
def _plane_height(window: F64, y: float, x: float) -> float:
    """Return the height at (x, y) of the plane with these moments; slopes have a weak prior."""
    w, wx, wy, wxx, wxy, wyy, wz, wxz, wyz = window
    if w < 1e-9:  # nothing known on the whole map
        return 0.0
    mean_x, mean_y, mean_z = wx / w, wy / w, wz / w
    xx = wxx - wx * mean_x + _SLOPE_PRIOR
    yy = wyy - wy * mean_y + _SLOPE_PRIOR
    xy = wxy - wx * mean_y
    xz = wxz - wx * mean_z
    yz = wyz - wy * mean_z
    det = xx * yy - xy * xy
    slope_x = (xz * yy - yz * xy) / det
    slope_y = (yz * xx - xz * xy) / det
    return float(mean_z + slope_x * (x - mean_x) + slope_y * (y - mean_y))


@compiled
def _heights_above(xyz_m: F32, rotation: F64, offset_m: F64, surface_m: F64, cell_m: float) -> F64:
    """Return (N,) heights of points above the bilinear surface, clamped to the map's edge."""
    heights = np.empty(len(xyz_m))
    for i in range(len(xyz_m)):
        x, y, z = xyz_m[i]
        east = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + offset_m[0]
        north = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + offset_m[1]
        up = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + offset_m[2]
        heights[i] = up - _at(surface_m, east / cell_m, north / cell_m)
    return heights


@compiled
def _at(surface_m: F64, x: float, y: float) -> float:
    """Return the bilinear height at x and y in cells from the corner."""
    last = surface_m.shape[0] - 1
    x, y = min(max(x - 0.5, 0.0), float(last)), min(max(y - 0.5, 0.0), float(last))
    column, row = min(int(x), last - 1), min(int(y), last - 1)
    fx, fy = x - column, y - row
    low = surface_m[row, column] * (1 - fx) + surface_m[row, column + 1] * fx
    high = surface_m[row + 1, column] * (1 - fx) + surface_m[row + 1, column + 1] * fx
    return float(low * (1 - fy) + high * fy)
