"""Plane curves by arc length: centre lines, lanes, pavements, turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64

STEP_M = 0.5  # Between samples: at a radius of 6 m a chord lies 5 mm inside its arc


class Place(NamedTuple):
    """A point and a direction."""

    x_m: float
    y_m: float
    heading_rad: float


class Interval(NamedTuple):
    """Part of a curve, by arc length."""

    start_m: float
    end_m: float

    @property
    def length_m(self) -> float:
        """Length of the part."""
        return self.end_m - self.start_m


@dataclass(frozen=True)
class Curve:
    """A curve sampled every STEP_M metres; ``xy_m[0]`` lies at arc length 0."""

    xy_m: F64
    """(K, 2)"""
    heading_rad: F64
    """(K,) continuous, not wrapped."""

    @property
    def length_m(self) -> float:
        """Arc length of the last sample."""
        return (len(self.xy_m) - 1) * STEP_M

    def at(self, s_m: F64, lateral_m: F64) -> F64:
        """Return (N, 3) x, y, heading at arc length ``s_m``, ``lateral_m`` to the left."""
        place = np.clip(s_m / STEP_M, 0.0, len(self.xy_m) - 1.0)
        grid = np.arange(len(self.xy_m))
        heading = np.interp(place, grid, self.heading_rad)
        x = np.interp(place, grid, self.xy_m[:, 0]) - lateral_m * np.sin(heading)
        y = np.interp(place, grid, self.xy_m[:, 1]) + lateral_m * np.cos(heading)
        return np.column_stack([x, y, heading])

    def offset(self, lateral_m: float) -> Curve:
        """Return the parallel curve ``lateral_m`` to the left."""
        normal = np.column_stack([-np.sin(self.heading_rad), np.cos(self.heading_rad)])
        return curve_through(self.xy_m + lateral_m * normal)

    def reversed(self) -> Curve:
        """Return the same curve in the other direction."""
        return Curve(self.xy_m[::-1].copy(), self.heading_rad[::-1] + np.pi)

    def part(self, start_m: float, end_m: float) -> Curve:
        """Return the part from ``start_m`` to ``end_m``, rounded to samples."""
        first, last = round(max(start_m, 0.0) / STEP_M), round(end_m / STEP_M) + 1
        return Curve(self.xy_m[first:last].copy(), self.heading_rad[first:last].copy())


def curve_through(points_m: F64) -> Curve:
    """Return the curve through (K, 2) dense points, resampled by arc length."""
    steps = np.hypot(*np.diff(points_m, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    s = np.arange(0.0, length[-1] + 1e-9, STEP_M)  # the end counts despite rounding
    xy = np.column_stack([np.interp(s, length, points_m[:, i]) for i in range(2)])
    tangent = np.gradient(xy, axis=0)
    return Curve(xy, np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])))


def curve_from_curvature(curvature_per_m: F64, heading_rad: float) -> Curve:
    """Return the curve from the origin with one curvature per step."""
    heading = heading_rad + np.concatenate([[0.0], np.cumsum(curvature_per_m)]) * STEP_M
    step = STEP_M * np.column_stack([np.cos(heading), np.sin(heading)])
    return Curve(np.concatenate([[[0.0, 0.0]], np.cumsum(step[:-1], axis=0)]), heading)


def connection(start: F64, end: F64) -> F64:
    """Return (K, 2) points of a cubic Bezier curve from one (x, y, heading) to another."""
    # a handle of 0.39 chords makes a quarter circle, longer ones a sharper turn at the apex
    reach = 0.42 * np.hypot(*(end[:2] - start[:2])) * 1.1
    a = start[:2] + reach * np.array([np.cos(start[2]), np.sin(start[2])])
    b = end[:2] - reach * np.array([np.cos(end[2]), np.sin(end[2])])
    u = np.linspace(0.0, 1.0, 80)[:, None]
    v = 1.0 - u
    curve: F64 = v**3 * start[:2] + 3 * v**2 * u * a + 3 * v * u**2 * b + u**3 * end[:2]
    return curve


@compiled
def place_beside(xy_m: F64, heading_rad: F64, s_m: float, lateral_m: float) -> Place:
    """Return one place beside a sampled curve, as ``Curve.at``."""
    inside = min(max(s_m / STEP_M, 0.0), len(xy_m) - 1.0)
    row = min(int(inside), len(xy_m) - 2)
    u = inside - row
    heading = heading_rad[row] * (1.0 - u) + heading_rad[row + 1] * u
    x = xy_m[row, 0] * (1.0 - u) + xy_m[row + 1, 0] * u - lateral_m * np.sin(heading)
    y = xy_m[row, 1] * (1.0 - u) + xy_m[row + 1, 1] * u + lateral_m * np.cos(heading)
    return Place(x, y, heading)


class Paths(NamedTuple):
    """Several curves side by side; named tuple for numba."""

    samples: F64
    """(K, 4) x, y, heading, curvature of all curves one after another."""
    start: I64
    """(P + 1,) first row of each curve."""


class PathPoint(NamedTuple):
    """A point of a path."""

    x_m: float
    y_m: float
    heading_rad: float
    curvature_per_m: float


class SmoothPoint(NamedTuple):
    """A point of a path with its first (dx, dy) and second (ddx, ddy) derivatives by arc length."""

    x_m: float
    y_m: float
    dx: float
    dy: float
    ddx: float
    ddy: float


def stack(curves: list[Curve]) -> Paths:
    """Return the curves in one table, with their curvature."""
    rows = [
        np.column_stack([c.xy_m, c.heading_rad, np.gradient(c.heading_rad, STEP_M)]) for c in curves
    ]
    start = np.concatenate([[0], np.cumsum([len(row) for row in rows])])
    return Paths(np.concatenate(rows), start.astype(np.int64))


@compiled
def sample(paths: Paths, path: int, s_m: float) -> PathPoint:
    """Return the point at arc length ``s_m`` of a path; straight on beyond its ends."""
    first, count = paths.start[path], paths.start[path + 1] - paths.start[path]
    place = s_m / STEP_M
    inside = min(max(place, 0.0), count - 1.0)
    row = min(int(inside), count - 2)
    u = inside - row
    table = paths.samples
    a, b = first + row, first + row + 1
    heading = table[a, 2] * (1.0 - u) + table[b, 2] * u
    beyond = (place - inside) * STEP_M
    return PathPoint(
        table[a, 0] * (1.0 - u) + table[b, 0] * u + beyond * np.cos(heading),
        table[a, 1] * (1.0 - u) + table[b, 1] * u + beyond * np.sin(heading),
        heading,
        table[a, 3] * (1.0 - u) + table[b, 3] * u,
    )


@compiled
def sample_smooth(paths: Paths, path: int, s_m: float) -> SmoothPoint:
    """Return a point of a path as a cubic through its samples and their headings.

    Unlike in ``sample``, position, direction and curvature are derivatives of one another.
    """
    first, count = paths.start[path], paths.start[path + 1] - paths.start[path]
    inside = min(max(s_m / STEP_M, 0.0), count - 1.0)
    row = min(int(inside), count - 2)
    a, b = paths.samples[first + row], paths.samples[first + row + 1]
    u, beyond = inside - row, s_m - inside * STEP_M
    x, dx, ddx = _hermite(a[0], np.cos(a[2]) * STEP_M, b[0], np.cos(b[2]) * STEP_M, u)
    y, dy, ddy = _hermite(a[1], np.sin(a[2]) * STEP_M, b[1], np.sin(b[2]) * STEP_M, u)
    if beyond != 0.0:
        ddx = ddy = 0.0
    return SmoothPoint(x + beyond * dx, y + beyond * dy, dx, dy, ddx, ddy)


@compiled
def _hermite(p: float, m: float, q: float, n: float, u: float) -> tuple[float, float, float]:
    """Return value and first two derivatives by arc length of the cubic between two samples."""
    rise, bow = 3.0 * (q - p) - 2.0 * m - n, 2.0 * (p - q) + m + n
    value = p + u * (m + u * (rise + u * bow))
    slope = (m + u * (2.0 * rise + 3.0 * u * bow)) / STEP_M
    return value, slope, (2.0 * rise + 6.0 * u * bow) / (STEP_M * STEP_M)
