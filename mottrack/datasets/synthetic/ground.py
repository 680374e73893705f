"""Lays out the ground: slopes, waves, kerbs, roughness, and what it is made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mottrack.datasets.synthetic.materials import ASPHALT, CONCRETE, GRASS
from mottrack.datasets.synthetic.roads import Road, RoadNetwork
from mottrack.datasets.synthetic.terrain import Terrain

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
    rough = np.where(surface == GRASS, rng.uniform(0.01, 0.06), rng.uniform(0.002, 0.012))
    height += (rough * rng.standard_normal(surface.shape, dtype=np.float32)).astype(np.float64)
    frame = (extent[0], extent[2], 1.0 / CELL_M)
    return Terrain(height.astype(np.float32), surface, frame, STEEPEST + 0.02)


def _waves(
    rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(H, W) a tilted plane and four long waves, together within STEEPEST."""
    slope, downhill = STEEPEST * float(rng.beta(1.0, 2.5)) * 0.6, rng.uniform(-np.pi, np.pi)
    height = slope * (np.cos(downhill) * x[None, :] + np.sin(downhill) * y[:, None])
    spare = (STEEPEST - slope) * float(rng.uniform(0.0, 0.9)) / 4.0
    for _ in range(4):
        wave = 2.0 * np.pi / float(rng.uniform(45.0, 220.0))
        way, phase = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 2.0 * np.pi)
        u, v = wave * np.cos(way) * x + phase, wave * np.sin(way) * y
        # sin(u + v) in two outer products: one sine per grid point would take longer than a sweep
        crest = np.outer(np.cos(v), np.sin(u)) + np.outer(np.sin(v), np.cos(u))
        height += spare / wave * crest
    return np.asarray(height)


def _surfaces(
    network: RoadNetwork, extent: Extent, shape: tuple[int, int]
) -> NDArray[np.int8]:
    surface = np.full(shape, GRASS, dtype=np.int8)
    for road in network.roads:
        _paint(surface, extent, road, (road.profile.half_m, CONCRETE))
    for road in network.roads:
        _paint(surface, extent, road, (road.profile.half_carriageway_m, ASPHALT))
    return surface


def _paint(
    surface: NDArray[np.int8], extent: Extent, road: Road, stroke: tuple[float, int]
) -> None:
    """Paints a stroke of half width and material along a road."""
    half, material = stroke
    s = np.arange(0.0, road.centre.length_m, 0.4 * CELL_M)
    place = road.centre.at(s, np.zeros(len(s)))
    across = np.append(np.arange(-half, half, 0.6 * CELL_M), half)
    xy = place[:, None, :2] + across[None, :, None] * np.stack(
        [-np.sin(place[:, 2]), np.cos(place[:, 2])], axis=-1
    )[:, None, :]
    col = np.rint((xy[..., 0] - extent[0]) / CELL_M).astype(np.int64)
    row = np.rint((xy[..., 1] - extent[2]) / CELL_M).astype(np.int64)
    inside = (col >= 0) & (col < surface.shape[1]) & (row >= 0) & (row < surface.shape[0])
    surface[row[inside], col[inside]] = material
