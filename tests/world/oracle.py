"""A brute-force ray caster in plain numpy, written on its own: every ray against every solid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def box_range(origin: Array, direction: Array, half: Array, cuts: Array) -> float:
    """Half-space clipping of a convex body; inf on a miss or from inside."""
    hx, hy, hz = half
    planes = [((1, 0, 0), hx), ((-1, 0, 0), hx), ((0, 1, 0), hy), ((0, -1, 0), hy)]
    planes += [((0, 0, 1), hz), ((0, 0, -1), hz)]
    if cuts[0] > 0:
        planes += [((a, b, 0), hx + hy - cuts[0]) for a in (-1, 1) for b in (-1, 1)]
    if cuts[1] > 0:
        k = cuts[1] / (2 * hz)
        planes += [((a, 0, k), hx - k * hz) for a in (-1, 1)]
    near, far = -np.inf, np.inf
    for normal, bound in planes:
        speed, gap = float(np.dot(normal, direction)), bound - float(np.dot(normal, origin))
        if speed > 0:
            far = min(far, gap / speed)
        elif speed < 0:
            near = max(near, gap / speed)
        elif gap < 0:
            return np.inf
    return near if 0 < near <= far else np.inf


def round_range(origin: Array, direction: Array, half: Array, *, upright: bool) -> float:
    """Smallest positive root of the quadric; for a cylinder also the caps."""
    axes = 2 if upright else 3
    o, d = origin[:axes] / half[:axes], direction[:axes] / half[:axes]
    a, b, c = float(d @ d), float(o @ d), float(o @ o) - 1.0
    candidates = []
    if b * b - a * c > 0:
        t = (-b - np.sqrt(b * b - a * c)) / a
        z = origin[2] + t * direction[2]
        if not upright or abs(z) <= half[2]:
            candidates.append(t)
    if upright and direction[2] != 0:
        for cap in (-half[2], half[2]):
            t = (cap - origin[2]) / direction[2]
            p = (origin[:2] + t * direction[:2]) / half[:2]
            if p @ p <= 1 and direction[2] * cap < 0:
                candidates.append(t)
    return min((t for t in candidates if t > 0), default=np.inf)


def solid_range(solids, p: int, tau: float, origin: Array, direction: Array) -> float:
    """Range to solid ``p`` at a time, for an opaque material."""
    centre = solids.centre_m[p] + tau * solids.velocity_mps[p]
    centre = centre + tau * tau / 2 * solids.acceleration_mps2[p]
    yaw = solids.yaw_rad[p] + tau * solids.yaw_rate_radps[p]
    rotation = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    o, d = rotation @ (origin - centre), rotation @ direction
    if solids.kind[p] == 0:
        return box_range(o, d, solids.half_m[p], solids.chamfer_m[p])
    return round_range(o, d, solids.half_m[p], upright=solids.kind[p] == 1)


def nearest(solids, tau: float, origin: Array, direction: Array) -> tuple[float, int]:
    """(range, solid) met first, the ground not considered."""
    ranges = [solid_range(solids, p, tau, origin, direction) for p in range(len(solids.kind))]
    best = int(np.argmin(ranges))
    return ranges[best], best
