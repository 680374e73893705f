"""A ray against one solid, in the solid's own frame.

Each function returns (near, far, cosine): the two ray parameters and the cosine of incidence at
``near``; near > far means a miss. Directions are unit vectors, so parameters are metres.
"""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled

MISS = (np.inf, -np.inf, 0.0)
_TINY = 1e-12
_SQRT_HALF = np.sqrt(0.5)
Vector = tuple[float, float, float]
Hit = tuple[float, float, float]


@compiled(error_model="numpy")
def clip_slab(hit: Hit, offset: float, slope: float, half_m: float) -> Hit:
    """Clips the part ``near .. far`` of a ray to |offset + t slope| <= half_m."""
    near, far, cosine = hit
    inverse = 1.0 / slope if abs(slope) > _TINY else 1.0 / _TINY
    middle, width = -offset * inverse, half_m * abs(inverse)
    if middle - width > near:
        near, cosine = middle - width, abs(slope)
    return near, min(far, middle + width), cosine


@compiled(error_model="numpy")
def hit_box(
    origin: Vector, direction: Vector, half_m: Vector, chamfer_m: tuple[float, float]
) -> Hit:
    """Ray against a box centred at the origin, with cut edges where ``chamfer_m`` is not 0."""
    near, far, cosine = clip_slab((-np.inf, np.inf, 0.0), origin[0], direction[0], half_m[0])
    near, far, cosine = clip_slab((near, far, cosine), origin[1], direction[1], half_m[1])
    near, far, cosine = clip_slab((near, far, cosine), origin[2], direction[2], half_m[2])
    if near > far:
        return near, far, cosine
    hit = (near, far, cosine)
    if chamfer_m[0] > 0.0:
        hit = _clip_upright_edges(hit, origin, direction, half_m[0] + half_m[1] - chamfer_m[0])
    if chamfer_m[1] > 0.0:
        hit = _clip_upper_edges(hit, origin, direction, (half_m[0], half_m[2], chamfer_m[1]))
    return hit


@compiled(error_model="numpy")
def _clip_upright_edges(hit: Hit, origin: Vector, direction: Vector, reach_m: float) -> Hit:
    """|x| + |y| <= reach_m: the box loses its four upright edges."""
    half = reach_m * _SQRT_HALF
    for sign in (1.0, -1.0):
        offset = (origin[0] + sign * origin[1]) * _SQRT_HALF
        slope = (direction[0] + sign * direction[1]) * _SQRT_HALF
        hit = clip_slab(hit, offset, slope, half)
    return hit


@compiled(error_model="numpy")
def _clip_upper_edges(
    hit: Hit,
    origin: Vector,
    direction: Vector,
    shape: tuple[float, float, float],
) -> Hit:
    """Slanted front and rear: |x| narrows linearly by the chamfer from bottom to top."""
    half_x, half_z, cut = shape
    tilt = cut / (2.0 * half_z)
    norm = np.sqrt(1.0 + tilt * tilt)
    for sign in (1.0, -1.0):
        # plane sign x + tilt (z + half_z) <= half_x; the far side of the slab is out of reach
        offset = (sign * origin[0] + tilt * (origin[2] + half_z) - half_x) / norm
        slope = (sign * direction[0] + tilt * direction[2]) / norm
        hit = clip_slab(hit, offset + 1e4, slope, 1e4)
    return hit


@compiled(error_model="numpy")
def hit_ellipsoid(origin: Vector, direction: Vector, half_m: Vector) -> Hit:
    """Ray against an ellipsoid centred at the origin."""
    a = b = c = 0.0
    for axis in range(3):
        o, d = origin[axis] / half_m[axis], direction[axis] / half_m[axis]
        a, b, c = a + d * d, b + o * d, c + o * o
    root = b * b - a * (c - 1.0)
    if root <= 0.0:
        return MISS
    root = np.sqrt(root)
    near, far = (-b - root) / a, (-b + root) / a
    return near, far, _ellipsoid_cosine(origin, direction, half_m, near)


@compiled(error_model="numpy")
def _ellipsoid_cosine(
    origin: Vector,
    direction: Vector,
    half_m: Vector,
    near: float,
) -> float:
    """Cosine between the ray and the gradient of the quadric at ``near``."""
    dot = norm = 0.0
    for axis in range(3):
        gradient = (origin[axis] + near * direction[axis]) / (half_m[axis] * half_m[axis])
        dot, norm = dot + gradient * direction[axis], norm + gradient * gradient
    return float(abs(dot) / np.sqrt(norm))


@compiled(error_model="numpy")
def hit_cylinder(origin: Vector, direction: Vector, half_m: Vector) -> Hit:
    """Ray against an upright elliptic cylinder centred at the origin."""
    a = b = c = 0.0
    for axis in range(2):
        o, d = origin[axis] / half_m[axis], direction[axis] / half_m[axis]
        a, b, c = a + d * d, b + o * d, c + o * o
    root = b * b - a * (c - 1.0)
    if root <= 0.0 or a <= _TINY:
        return MISS
    root = np.sqrt(root)
    near, far = (-b - root) / a, (-b + root) / a
    side = np.sqrt(1.0 - direction[2] * direction[2])
    hit = (near, far, side * root / np.sqrt(a))
    capped: Hit = clip_slab(hit, origin[2], direction[2], half_m[2])
    return capped
