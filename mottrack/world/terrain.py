"""The ground: a height map over the world, and rays against it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I8, I64
from mottrack.world.intersect import Vector

_STRIDE_M = 0.5
_STRIDE_GROWTH = 0.03
Frame = tuple[float, float, float]
"""(x_min_m, y_min_m, cells per metre) of a grid."""


class Terrain(NamedTuple):
    """Heights on a square grid, interpolated bilinearly; named tuple for numba."""

    height_m: F32
    """(H, W) height of the grid points, row along y."""
    surface: I8
    """(H, W) material around each grid point."""
    frame: Frame
    slope: float
    """Bound on the slope, kerbs apart."""


@compiled(inline="always")
def height_at(height_m: F32, frame: Frame, x_m: float, y_m: float) -> float:
    """Height of the ground; beyond the grid that of its edge."""
    u = min(max((x_m - frame[0]) * frame[2], 0.0), height_m.shape[1] - 1.001)
    v = min(max((y_m - frame[1]) * frame[2], 0.0), height_m.shape[0] - 1.001)
    col, row = int(u), int(v)
    u, v = u - col, v - row
    low = height_m[row, col] + (height_m[row, col + 1] - height_m[row, col]) * u
    high = height_m[row + 1, col] + (height_m[row + 1, col + 1] - height_m[row + 1, col]) * u
    return float(low + (high - low) * v)


@compiled
def heights_at(terrain: Terrain, xy_m: F64) -> F64:
    """(N,) heights of the ground at (N, 2) points."""
    out = np.empty(len(xy_m))
    for i in range(len(xy_m)):
        out[i] = height_at(terrain.height_m, terrain.frame, xy_m[i, 0], xy_m[i, 1])
    return out


@compiled
def height_here(terrain: Terrain, x_m: float, y_m: float) -> float:
    """Height of the ground at one point."""
    return float(height_at(terrain.height_m, terrain.frame, x_m, y_m))


@compiled(inline="always")
def surface_at(surface: I8, frame: Frame, x_m: float, y_m: float) -> int:
    """Material of the ground at a point."""
    col = min(max(int((x_m - frame[0]) * frame[2] + 0.5), 0), surface.shape[1] - 1)
    row = min(max(int((y_m - frame[1]) * frame[2] + 0.5), 0), surface.shape[0] - 1)
    return int(surface[row, col])


@compiled
def touches(terrain: Terrain, material: int, xy_m: tuple[float, float], reach_m: float) -> bool:
    """Whether a material lies at a point or ``reach_m`` from it along an axis."""
    x, y = xy_m
    for dx, dy in ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        near = surface_at(terrain.surface, terrain.frame, x + reach_m * dx, y + reach_m * dy)
        if near == material:
            return True
    return False


@compiled(error_model="numpy")
def ground_walk(
    height_m: F32,
    frame: Frame,
    sensor_m: F64,
    rays: F64,
    choice: tuple[I64, int, F64],
) -> F64:
    """(R,) range at which each beam goes under ground, inf if not before its limit.

    Beams over each other share one section through the ground, sampled every _STRIDE_M and more
    coarsely far away, straight in between. A beam is over the ground at least as far as the one
    below it, so one walk outwards serves all.

    Args:
        height_m: heights of the terrain.
        frame: of the heights.
        sensor_m: (3,) where the beams start.
        rays: (R, 6) direction of each beam, and x, y and climb per metre of way; lowest first.
        choice: number of the stand of each beam, which stand to do, and (R,) ranges beyond which
            the answer does not matter.
    """
    stands, stand, limit_m = choice
    hits = np.full(len(rays), np.inf)
    way = before = 0.0
    ground = ground_before = height_at(height_m, frame, sensor_m[0], sensor_m[1])
    for ring in range(len(rays)):
        if stands[ring] != stand:
            continue
        x, y, climb = rays[ring, 3], rays[ring, 4], rays[ring, 5]
        end = limit_m[ring]
        while way < end and sensor_m[2] + climb * way >= ground:
            before, ground_before = way, ground
            way += max(_STRIDE_M, _STRIDE_GROWTH * way)
            ground = height_at(height_m, frame, sensor_m[0] + way * x, sensor_m[1] + way * y)
        over = sensor_m[2] + climb * before - ground_before
        under = ground - sensor_m[2] - climb * way
        if under > 0.0:
            there = before + (way - before) * over / (over + under)
            hits[ring] = there * np.sqrt(1.0 + climb * climb)
    return hits


@compiled(error_model="numpy", inline="always")
def ground_cosine(
    height_m: F32, frame: Frame, xy_m: tuple[float, float], direction: Vector
) -> float:
    """Cosine of incidence of a ray on the ground at a point, by the slope of its cell."""
    rows, cols = height_m.shape
    col = min(max(int((xy_m[0] - frame[0]) * frame[2]), 0), cols - 2)
    row = min(max(int((xy_m[1] - frame[1]) * frame[2]), 0), rows - 2)
    here = height_m[row, col]
    slope_x = (height_m[row, col + 1] - here) * frame[2]
    slope_y = (height_m[row + 1, col] - here) * frame[2]
    norm = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return float(abs(direction[2] - slope_x * direction[0] - slope_y * direction[1]) / norm)
