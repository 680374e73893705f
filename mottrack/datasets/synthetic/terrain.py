"""The ground: a height map over the world, and rays against it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mottrack.datasets.synthetic.intersect import Vector

_STRIDE_M = 1.0
_STRIDE_GROWTH = 0.05
_CHORDS = 2
Frame = tuple[float, float, float]
"""(x_min_m, y_min_m, cells per metre) of a grid."""


class Terrain(NamedTuple):
    """Heights on a square grid, interpolated bilinearly; named tuple for numba."""

    height_m: NDArray[np.float32]
    """(H, W) height of the grid points, row along y."""
    surface: NDArray[np.int8]
    """(H, W) material around each grid point."""
    frame: Frame
    slope: float
    """Bound on the slope, kerbs apart."""


@njit(cache=True, inline="always")
def height_at(height_m: NDArray[np.float32], frame: Frame, x_m: float, y_m: float) -> float:
    """Height of the ground; beyond the grid that of its edge."""
    u = min(max((x_m - frame[0]) * frame[2], 0.0), height_m.shape[1] - 1.001)
    v = min(max((y_m - frame[1]) * frame[2], 0.0), height_m.shape[0] - 1.001)
    col, row = int(u), int(v)
    u, v = u - col, v - row
    low = height_m[row, col] + (height_m[row, col + 1] - height_m[row, col]) * u
    high = height_m[row + 1, col] + (height_m[row + 1, col + 1] - height_m[row + 1, col]) * u
    return low + (high - low) * v


@njit(cache=True)
def heights_at(terrain: Terrain, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) heights of the ground at (N, 2) points."""
    out = np.empty(len(xy_m))
    for i in range(len(xy_m)):
        out[i] = height_at(terrain.height_m, terrain.frame, xy_m[i, 0], xy_m[i, 1])
    return out


@njit(cache=True)
def surface_at(surface: NDArray[np.int8], frame: Frame, x_m: float, y_m: float) -> int:
    """Material of the ground at a point."""
    col = min(max(int((x_m - frame[0]) * frame[2] + 0.5), 0), surface.shape[1] - 1)
    row = min(max(int((y_m - frame[1]) * frame[2] + 0.5), 0), surface.shape[0] - 1)
    return int(surface[row, col])


@njit(cache=True, error_model="numpy")
def hit_ground(
    terrain: tuple[NDArray[np.float32], Frame, float],
    origin: Vector,
    direction: Vector,
    limit_m: float,
) -> float:
    """Ray parameter at which a ray first goes under ground, inf if not before ``limit_m``.

    Steps as far as the slope bound allows, and never less than a stride in which the smooth ground
    cannot rise and fall again; ends with chords between above and below (regula falsi).

    Args:
        terrain: heights, their frame, and the bound on the slope.
        origin: where the ray starts, world frame.
        direction: unit vector, world frame.
        limit_m: how far to look.
    """
    heights, frame, slope = terrain
    ox, oy, oz = origin
    dx, dy, dz = direction
    closing = slope * np.sqrt(1.0 - dz * dz) - dz
    if closing <= 1e-3:
        return np.inf
    t, gap = 0.0, oz - height_at(heights, frame, ox, oy)
    ahead, below = 0.0, 1.0
    while below >= 0.0:
        if ahead > limit_m:
            return np.inf
        ahead = t + max(gap / closing, _STRIDE_M + _STRIDE_GROWTH * t)
        below = oz + ahead * dz - height_at(heights, frame, ox + ahead * dx, oy + ahead * dy)
        if below >= 0.0:
            t, gap = ahead, below
    for _ in range(_CHORDS):
        middle = t + (ahead - t) * gap / (gap - below)
        there = oz + middle * dz - height_at(heights, frame, ox + middle * dx, oy + middle * dy)
        if there < 0.0:
            ahead, below = middle, there
        else:
            t, gap = middle, there
    return t + (ahead - t) * gap / (gap - below)


@njit(cache=True, error_model="numpy")
def ground_cosine(
    height_m: NDArray[np.float32], frame: Frame, xy_m: tuple[float, float], direction: Vector
) -> float:
    """Cosine of incidence of a ray on the ground at a point."""
    reach = 1.0 / frame[2]
    here = height_at(height_m, frame, xy_m[0], xy_m[1])
    slope_x = (height_at(height_m, frame, xy_m[0] + reach, xy_m[1]) - here) * frame[2]
    slope_y = (height_at(height_m, frame, xy_m[0], xy_m[1] + reach) - here) * frame[2]
    norm = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return abs(direction[2] - slope_x * direction[0] - slope_y * direction[1]) / norm
