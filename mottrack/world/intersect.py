"""Intersections of a ray with one solid, in the solid's own frame.

Directions are unit vectors, so that ray parameters are metres.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled


class Vector(NamedTuple):
    """A point or direction."""

    x: float
    y: float
    z: float


class Hit(NamedTuple):
    """The part of a ray inside a solid; ``near_m > far_m`` is a miss."""

    near_m: float
    far_m: float
    cosine: float
    """Cosine of incidence at ``near_m``."""


_MISS = Hit(np.inf, -np.inf, 0.0)
_LINE = Hit(-np.inf, np.inf, 0.0)
_TINY = 1e-12
"""Slope below which a ray counts as parallel; far above the rounding of a unit vector's square."""
_SQRT_HALF = np.sqrt(0.5)
_HALF_SPACE_M = 1e4
"""Half width of a slab that stands for a half space: its far side is beyond any range."""


@compiled(error_model="numpy")
def _clip_slab(hit: Hit, offset: float, slope: float, half_m: float) -> Hit:
    """Clip the part of a ray inside to ``|offset + t slope| <= half_m``."""
    near, far, cosine = hit
    inverse = 1.0 / slope if abs(slope) > _TINY else 1.0 / _TINY
    middle, width = -offset * inverse, half_m * abs(inverse)
    if middle - width > near:
        near, cosine = middle - width, abs(slope)
    return Hit(near, min(far, middle + width), cosine)


@compiled(error_model="numpy")
def hit_box(
    origin: Vector, direction: Vector, half_m: Vector, chamfer_m: tuple[float, float]
) -> Hit:
    """Intersect a box centred at the origin, with cut edges where ``chamfer_m`` is not 0."""
    hit = _clip_slab(_LINE, origin.x, direction.x, half_m.x)
    hit = _clip_slab(hit, origin.y, direction.y, half_m.y)
    hit = _clip_slab(hit, origin.z, direction.z, half_m.z)
    if hit.near_m > hit.far_m:
        return hit
    if chamfer_m[0] > 0.0:
        hit = _clip_upright_edges(hit, origin, direction, half_m.x + half_m.y - chamfer_m[0])
    if chamfer_m[1] > 0.0:
        hit = _clip_upper_edges(hit, origin, direction, half_m, chamfer_m[1])
    return hit


@compiled(error_model="numpy")
def _clip_upright_edges(hit: Hit, origin: Vector, direction: Vector, reach_m: float) -> Hit:
    """Clip to ``|x| + |y| <= reach_m``: the box loses its four upright edges."""
    half = reach_m * _SQRT_HALF
    for sign in (1.0, -1.0):
        offset = (origin.x + sign * origin.y) * _SQRT_HALF
        slope = (direction.x + sign * direction.y) * _SQRT_HALF
        hit = _clip_slab(hit, offset, slope, half)
    return hit


@compiled(error_model="numpy")
def _clip_upper_edges(
    hit: Hit, origin: Vector, direction: Vector, half_m: Vector, chamfer_m: float
) -> Hit:
    """Clip to a slanted front and rear: |x| narrows by the chamfer from bottom to top."""
    tilt = chamfer_m / (2.0 * half_m.z)
    norm = np.sqrt(1.0 + tilt * tilt)
    for sign in (1.0, -1.0):
        # the half space sign x + tilt (z + half z) <= half x
        offset = (sign * origin.x + tilt * (origin.z + half_m.z) - half_m.x) / norm
        slope = (sign * direction.x + tilt * direction.z) / norm
        hit = _clip_slab(hit, offset + _HALF_SPACE_M, slope, _HALF_SPACE_M)
    return hit


@compiled(error_model="numpy")
def hit_ellipsoid(origin: Vector, direction: Vector, half_m: Vector) -> Hit:
    """Intersect an ellipsoid centred at the origin."""
    a = b = c = 0.0
    for axis in range(3):
        o, d = origin[axis] / half_m[axis], direction[axis] / half_m[axis]
        a, b, c = a + d * d, b + o * d, c + o * o
    root = b * b - a * (c - 1.0)
    if root <= 0.0:
        return _MISS
    root = np.sqrt(root)
    near, far = (-b - root) / a, (-b + root) / a
    dot = norm = 0.0
    for axis in range(3):
        gradient = (origin[axis] + near * direction[axis]) / (half_m[axis] * half_m[axis])
        dot, norm = dot + gradient * direction[axis], norm + gradient * gradient
    return Hit(near, far, abs(dot) / np.sqrt(norm))


@compiled(error_model="numpy")
def hit_cylinder(origin: Vector, direction: Vector, half_m: Vector) -> Hit:
    """Intersect an upright elliptic cylinder centred at the origin."""
    a = b = c = 0.0
    for axis in range(2):
        o, d = origin[axis] / half_m[axis], direction[axis] / half_m[axis]
        a, b, c = a + d * d, b + o * d, c + o * o
    root = b * b - a * (c - 1.0)
    if root <= 0.0 or a <= _TINY:
        return _MISS
    root = np.sqrt(root)
    near, far = (-b - root) / a, (-b + root) / a
    side = np.sqrt(1.0 - direction.z * direction.z)
    hit = Hit(near, far, side * root / np.sqrt(a))
    return _clip_slab(hit, origin.z, direction.z, half_m.z)
