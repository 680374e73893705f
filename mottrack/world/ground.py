"""Generation of the ground: slopes, waves, kerbs, roughness, and its materials."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I8, Mask
from mottrack.world.curves import STEP_M, place_beside
from mottrack.world.materials import ASPHALT, CONCRETE, GRASS
from mottrack.world.roads import Road, RoadNetwork
from mottrack.world.terrain import GridFrame, Terrain

_CELL_M = 0.5
_STEEPEST = 0.05  # Slope; streets in towns are seldom steeper than 5 %


class Extent(NamedTuple):
    """An area in world coordinates, metres."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float


class _Waves(NamedTuple):
    """Sines and cosines of a phase along one axis."""

    sin: F64
    cos: F64


def build_ground(rng: np.random.Generator, network: RoadNetwork, extent: Extent) -> Terrain:
    """Build the terrain of a network: slopes to 5 %, bumps, kerbs of 8 to 16 cm."""
    x = np.arange(extent.x_min, extent.x_max + _CELL_M, _CELL_M)
    y = np.arange(extent.y_min, extent.y_max + _CELL_M, _CELL_M)
    surface = np.full((len(y), len(x)), GRASS, dtype=np.int8)
    for road in network.roads:
        _paint(surface, extent, road, road.profile.half_m, CONCRETE)
    for road in network.roads:
        _paint(surface, extent, road, road.profile.half_carriageway_m, ASPHALT)
    height = _waves(rng, x, y)
    kerb = 0.0 if network.kind == "motorway" else float(rng.uniform(0.08, 0.16))
    height += kerb * (surface != ASPHALT)
    # peak to peak, by eye: mown to rough grass, smooth asphalt to cobbles
    grass, paved = float(rng.uniform(0.03, 0.2)), float(rng.uniform(0.006, 0.04))
    rough = np.where(surface == GRASS, grass, paved)
    height += rough * (rng.random(surface.shape, dtype=np.float32) - np.float32(0.5))
    frame = GridFrame(extent.x_min, extent.y_min, 1.0 / _CELL_M)
    return Terrain(height.astype(np.float32), surface, frame)


def _waves(rng: np.random.Generator, x: F64, y: F64) -> F64:
    """Return (H, W) a tilted plane and four long waves, together within _STEEPEST."""
    slope, downhill = _STEEPEST * float(rng.beta(1.0, 2.5)) * 0.6, rng.uniform(-np.pi, np.pi)
    height: F64 = slope * (np.cos(downhill) * x[None, :] + np.sin(downhill) * y[:, None])
    spare = (_STEEPEST - slope) * float(rng.uniform(0.0, 0.9)) / 4.0
    wave = 2.0 * np.pi / rng.uniform(45.0, 220.0, 4)
    heading, phase = rng.uniform(-np.pi, np.pi, 4), rng.uniform(0.0, 2.0 * np.pi, 4)
    u = np.outer(wave * np.cos(heading), x) + phase[:, None]
    v = np.outer(y, wave * np.sin(heading))
    _add_waves(height, spare / wave, _Waves(np.sin(u), np.cos(u)), _Waves(np.sin(v), np.cos(v)))
    return height


@compiled
def _add_waves(height: F64, size_m: F64, along: _Waves, across: _Waves) -> None:
    """Add waves sin(u + v) from the sines and cosines of u (along x) and v (along y).

    One sine per grid point would take longer than a sweep; a matrix product would be as fast but
    rounds differently with another number of threads.
    """
    for row in range(height.shape[0]):
        for k in range(len(size_m)):
            c, s = size_m[k] * across.cos[row, k], size_m[k] * across.sin[row, k]
            for col in range(height.shape[1]):
                height[row, col] += c * along.sin[k, col] + s * along.cos[k, col]


def _paint(surface: I8, extent: Extent, road: Road, half_m: float, material: int) -> None:
    """Give a strip along a road, to ``half_m`` on both sides, a material."""
    # finer than the grid: no cell is skipped
    across = np.append(np.arange(-half_m, half_m, 0.6 * _CELL_M), half_m)
    curve = road.centre
    surface[_covered(surface.shape, curve.xy_m, curve.heading_rad, across, extent)] = material


@compiled
def _covered(
    shape: tuple[int, int], xy_m: F64, heading_rad: F64, across_m: F64, extent: Extent
) -> Mask:
    """Return which cells of a grid lie under a strip along a curve."""
    covered = np.zeros(shape, np.bool_)
    x_min, x_max, y_min, y_max = extent
    wide = across_m[-1] + 1.0
    for i in range(2 * len(xy_m) - 1):
        x, y, heading = place_beside(xy_m, heading_rad, 0.5 * i * STEP_M, 0.0)
        if not (x_min - wide < x < x_max + wide and y_min - wide < y < y_max + wide):
            continue
        for left in across_m:
            col = int(np.rint((x - left * np.sin(heading) - x_min) / _CELL_M))
            row = int(np.rint((y + left * np.cos(heading) - y_min) / _CELL_M))
            if 0 <= col < shape[1] and 0 <= row < shape[0]:
                covered[row, col] = True
    return covered
