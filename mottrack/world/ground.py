"""Lays out the ground: slopes, waves, kerbs, roughness, and what it is made of."""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I8
from mottrack.world.curves import STEP_M, place_beside
from mottrack.world.materials import ASPHALT, CONCRETE, GRASS
from mottrack.world.roads import Road, RoadNetwork
from mottrack.world.terrain import Terrain

CELL_M = 0.5
STEEPEST = 0.05
Extent = tuple[float, float, float, float]
"""(x_min, x_max, y_min, y_max) in metres."""


def lay_ground(rng: np.random.Generator, network: RoadNetwork, extent: Extent) -> Terrain:
    """The terrain of a network: slopes to 5 %, bumps, kerbs of 8 to 16 cm."""
    x = np.arange(extent[0], extent[1] + CELL_M, CELL_M)
    y = np.arange(extent[2], extent[3] + CELL_M, CELL_M)
    surface = _surfaces(network, extent, (len(y), len(x)))
    height = _waves(rng, x, y)
    kerb = 0.0 if network.kind == "motorway" else float(rng.uniform(0.08, 0.16))
    height += kerb * (surface != ASPHALT)
    grass, paved = float(rng.uniform(0.03, 0.2)), float(rng.uniform(0.006, 0.04))
    rough = np.where(surface == GRASS, grass, paved)
    height += rough * (rng.random(surface.shape, dtype=np.float32) - np.float32(0.5))
    frame = (extent[0], extent[2], 1.0 / CELL_M)
    return Terrain(height.astype(np.float32), surface, frame, STEEPEST + 0.02)


def _waves(rng: np.random.Generator, x: F64, y: F64) -> F64:
    """(H, W) a tilted plane and four long waves, together within STEEPEST."""
    slope, downhill = STEEPEST * float(rng.beta(1.0, 2.5)) * 0.6, rng.uniform(-np.pi, np.pi)
    height = slope * (np.cos(downhill) * x[None, :] + np.sin(downhill) * y[:, None])
    spare = (STEEPEST - slope) * float(rng.uniform(0.0, 0.9)) / 4.0
    wave = 2.0 * np.pi / rng.uniform(45.0, 220.0, 4)
    way, phase = rng.uniform(-np.pi, np.pi, 4), rng.uniform(0.0, 2.0 * np.pi, 4)
    u = np.outer(wave * np.cos(way), x) + phase[:, None]
    v = np.outer(y, wave * np.sin(way))
    _add_waves(height, spare / wave, (np.sin(u), np.cos(u)), (np.sin(v), np.cos(v)))
    return np.asarray(height)


@compiled
def _add_waves(
    height: F64,
    size_m: F64,
    along: tuple[F64, F64],
    across: tuple[F64, F64],
) -> None:
    """Adds waves sin(u + v) from the sines and cosines of u and v.

    One sine per grid point would take longer than a sweep; a matrix product would be as fast but
    rounds differently with another number of threads.
    """
    for row in range(height.shape[0]):
        for k in range(len(size_m)):
            c, s = size_m[k] * across[1][row, k], size_m[k] * across[0][row, k]
            for col in range(height.shape[1]):
                height[row, col] += c * along[0][k, col] + s * along[1][k, col]


def _surfaces(network: RoadNetwork, extent: Extent, shape: tuple[int, int]) -> I8:
    surface = np.full(shape, GRASS, dtype=np.int8)
    for road in network.roads:
        _paint(surface, extent, road, (road.profile.half_m, CONCRETE))
    for road in network.roads:
        _paint(surface, extent, road, (road.profile.half_carriageway_m, ASPHALT))
    return surface


def _paint(surface: I8, extent: Extent, road: Road, stroke: tuple[float, int]) -> None:
    """Paints a stroke of half width and material along a road."""
    half, material = stroke
    steps = np.arange(-half, half, 0.6 * CELL_M)
    _paint_stroke(surface, road.centre.xy_m, road.centre.heading_rad, steps, (*extent, material))


@compiled
def _paint_stroke(
    surface: I8,
    xy_m: F64,
    heading_rad: F64,
    across_m: F64,
    brush: tuple[float, float, float, float, int],
) -> None:
    x_min, x_max, y_min, y_max, material = brush
    wide = abs(across_m[0]) + 1.0
    for i in range(2 * len(xy_m) - 1):
        s = 0.5 * i * STEP_M
        x, y, heading = place_beside(xy_m, heading_rad, s, 0.0)
        if not (x_min - wide < x < x_max + wide and y_min - wide < y < y_max + wide):
            continue
        for k in range(len(across_m) + 1):
            left = across_m[k] if k < len(across_m) else -across_m[0]
            col = int(np.rint((x - left * np.sin(heading) - x_min) / CELL_M))
            row = int(np.rint((y + left * np.cos(heading) - y_min) / CELL_M))
            if 0 <= col < surface.shape[1] and 0 <= row < surface.shape[0]:
                surface[row, col] = material
