"""The ground: a height map over the world, and rays against it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I8, I64
from mottrack.world.intersect import Vector

# section of the ground along a beam: a step of half a metre, the grid's, growing to 3 % of the
# distance, at which neighbouring rings of a 64-beam sensor are further apart on the ground
_STRIDE_M = 0.5
_STRIDE_GROWTH = 0.03
_INSIDE = 1.001  # Keeps an interpolated place in the last cell of the grid


class GridFrame(NamedTuple):
    """Where a grid lies."""

    x_min_m: float
    y_min_m: float
    cells_per_m: float


class Terrain(NamedTuple):
    """Heights on a square grid, interpolated bilinearly; named tuple for numba."""

    height_m: F32
    """(H, W) height of the grid points, row along y."""
    surface: I8
    """(H, W) material around each grid point."""
    frame: GridFrame


class Beams(NamedTuple):
    """R beams of one column, lowest elevation first."""

    direction: F64
    """(R, 3) unit vectors in the world."""
    horizontal: F64
    """(R, 2) the same seen from above, as unit vectors."""
    climb: F64
    """(R,) rise per horizontal metre."""
    azimuth_group: I64
    """(R,) beams of one group have one azimuth."""


@compiled(inline="always")
def height_at(height_m: F32, frame: GridFrame, x_m: float, y_m: float) -> float:
    """Return the height of the ground; beyond the grid that of its edge."""
    u = min(max((x_m - frame.x_min_m) * frame.cells_per_m, 0.0), height_m.shape[1] - _INSIDE)
    v = min(max((y_m - frame.y_min_m) * frame.cells_per_m, 0.0), height_m.shape[0] - _INSIDE)
    col, row = int(u), int(v)
    u, v = u - col, v - row
    low = height_m[row, col] + (height_m[row, col + 1] - height_m[row, col]) * u
    high = height_m[row + 1, col] + (height_m[row + 1, col + 1] - height_m[row + 1, col]) * u
    return float(low + (high - low) * v)


@compiled
def heights_at(terrain: Terrain, xy_m: F64) -> F64:
    """Return the (N,) heights of the ground at (N, 2) points."""
    out = np.empty(len(xy_m))
    for i in range(len(xy_m)):
        out[i] = height_at(terrain.height_m, terrain.frame, xy_m[i, 0], xy_m[i, 1])
    return out


@compiled(inline="always")
def surface_at(surface: I8, frame: GridFrame, x_m: float, y_m: float) -> int:
    """Return the material of the ground at a point."""
    col = min(max(int((x_m - frame.x_min_m) * frame.cells_per_m + 0.5), 0), surface.shape[1] - 1)
    row = min(max(int((y_m - frame.y_min_m) * frame.cells_per_m + 0.5), 0), surface.shape[0] - 1)
    return int(surface[row, col])


@compiled
def touches(terrain: Terrain, material: int, xy_m: tuple[float, float], reach_m: float) -> bool:
    """Return whether a material lies at a point or ``reach_m`` from it along an axis."""
    x, y = xy_m
    for dx, dy in ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        near = surface_at(terrain.surface, terrain.frame, x + reach_m * dx, y + reach_m * dy)
        if near == material:
            return True
    return False


@compiled(error_model="numpy")
def ground_ranges(terrain: Terrain, sensor_m: F64, beams: Beams, group: int, limit_m: F64) -> F64:
    """Return the (R,) range at which each beam enters the ground, inf if not before its limit.

    Beams of one azimuth share one section through the ground, sampled every _STRIDE_M and more
    coarsely far away, straight in between. A beam is above the ground at least as far as the one
    below it, so one march outwards serves all.

    Args:
        terrain: the ground.
        sensor_m: (3,) where the beams start.
        beams: of one column.
        group: azimuth group to compute; beams of others get inf.
        limit_m: (R,) ranges beyond which the answer does not matter.
    """
    height_m, frame = terrain.height_m, terrain.frame
    ranges = np.full(len(beams.climb), np.inf)
    travelled = before = 0.0
    ground = ground_before = height_at(height_m, frame, sensor_m[0], sensor_m[1])
    for ring in range(len(ranges)):
        if beams.azimuth_group[ring] != group:
            continue
        x, y, climb = beams.horizontal[ring, 0], beams.horizontal[ring, 1], beams.climb[ring]
        end = limit_m[ring]
        while travelled < end and sensor_m[2] + climb * travelled >= ground:
            before, ground_before = travelled, ground
            travelled += max(_STRIDE_M, _STRIDE_GROWTH * travelled)
            ground = height_at(
                height_m, frame, sensor_m[0] + travelled * x, sensor_m[1] + travelled * y
            )
        over = sensor_m[2] + climb * before - ground_before
        under = ground - sensor_m[2] - climb * travelled
        if under > 0.0:
            there = before + (travelled - before) * over / (over + under)
            ranges[ring] = there * np.sqrt(1.0 + climb * climb)
    return ranges


@compiled(error_model="numpy", inline="always")
def ground_cosine(terrain: Terrain, x_m: float, y_m: float, ray: Vector) -> float:
    """Return the cosine of incidence of a ray on the ground at a point, by the cell's slope."""
    height_m, frame = terrain.height_m, terrain.frame
    rows, cols = height_m.shape
    col = min(max(int((x_m - frame.x_min_m) * frame.cells_per_m), 0), cols - 2)
    row = min(max(int((y_m - frame.y_min_m) * frame.cells_per_m), 0), rows - 2)
    here = height_m[row, col]
    slope_x = (height_m[row, col + 1] - here) * frame.cells_per_m
    slope_y = (height_m[row + 1, col] - here) * frame.cells_per_m
    norm = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return float(abs(ray.z - slope_x * ray.x - slope_y * ray.y) / norm)
