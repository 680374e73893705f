"""Casts the beams of one turn of a LiDAR against solids and ground.

A beam meets the nearest thing only (true occlusion). Things that let beams through draw from a
counter-based generator keyed by beam and solid, so the result does not depend on any order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mottrack.datasets.synthetic.culling import Candidates, Scan, find_candidates, solid_pose_at
from mottrack.datasets.synthetic.hashing import mix, unit
from mottrack.datasets.synthetic.intersect import (
    Hit,
    Vector,
    hit_box,
    hit_cylinder,
    hit_ellipsoid,
)
from mottrack.datasets.synthetic.materials import Materials
from mottrack.datasets.synthetic.porous import Chord, inside_return, window_return
from mottrack.datasets.synthetic.solids import BACKGROUND, BOX, CYLINDER, Solids
from mottrack.datasets.synthetic.terrain import Terrain, ground_cosine, hit_ground, surface_at

GROUND = -2
_NOTHING = -3
_LEAF_COSINE = 0.6
# columns of the table of candidates: the first three are the sensor's place in the solid's frame
_TURN, _HALF, _CUTS, _KIND, _OPACITY, _DENSITY, _CLUMPED = 3, 5, 8, 10, 11, 12, 13
_PITCH, _SHARE, _MATERIAL, _NUMBER, _BOUND, _FIRST, _LAST = 14, 15, 16, 17, 18, 19, 20
_FIELDS = 21


class World(NamedTuple):
    """All that a beam can meet; named tuple for numba."""

    solids: Solids
    materials: Materials
    terrain: Terrain


class Returns(NamedTuple):
    """What each beam met, (C, R) arrays; range is inf where it met nothing."""

    range_m: NDArray[np.float64]
    solid: NDArray[np.int64]
    """Row of the solid met, ``GROUND``, or below where nothing was met."""
    material: NDArray[np.int16]
    cosine: NDArray[np.float64]
    """Cosine of incidence; 0 for a beam that was mirrored away."""


def cast(scan: Scan, world: World, seed: int) -> Returns:
    """What every beam of ``scan`` meets in ``world``, the same for the same seed."""
    candidates = find_candidates(scan, world.solids)
    return _cast(scan, world, candidates, np.uint64(seed))


@njit(cache=True, error_model="numpy")
def _cast(scan: Scan, world: World, candidates: Candidates, seed: np.uint64) -> Returns:
    columns, rings = len(scan.time_s), len(scan.elevation_rad)
    returns = Returns(
        np.full((columns, rings), np.inf),
        np.full((columns, rings), _NOTHING),
        np.zeros((columns, rings), np.int16),
        np.zeros((columns, rings)),
    )
    beams = _beams(scan)
    near = np.empty((len(world.solids.kind), _FIELDS))
    for column in range(columns):
        chosen = candidates.solid[candidates.start[column] : candidates.start[column + 1]]
        _enter_frames(scan, world, chosen, column, near)
        near[: len(chosen), _BOUND] = candidates.near_m[chosen]
        rays = _directions(scan, beams, column)
        met = _first_solids(near[: len(chosen)], rays, mix(seed, column), scan.max_range_m)
        _keep_nearest(world.terrain, scan.origin_m[column], rays, met)
        for ring in range(rings):
            index = int(met[ring, 2])
            if index == _NOTHING:
                continue
            returns.range_m[column, ring], returns.cosine[column, ring] = met[ring, 0], met[ring, 1]
            returns.material[column, ring] = int(met[ring, 3])
            returns.solid[column, ring] = chosen[index] if index >= 0 else GROUND
    return returns


@njit(cache=True)
def _beams(scan: Scan) -> NDArray[np.float64]:
    """(R, 4) cosine and sine of the elevation and of the azimuth offset of each beam."""
    beams = np.empty((len(scan.elevation_rad), 4))
    beams[:, 0], beams[:, 1] = np.cos(scan.elevation_rad), np.sin(scan.elevation_rad)
    beams[:, 2], beams[:, 3] = np.cos(scan.offset_rad), np.sin(scan.offset_rad)
    return beams


@njit(cache=True)
def _directions(scan: Scan, beams: NDArray[np.float64], column: int) -> NDArray[np.float64]:
    """(R, 3) directions of the beams of one column in the world."""
    ca, sa = np.cos(scan.azimuth_rad[column]), np.sin(scan.azimuth_rad[column])
    r = scan.rotation[column]
    rays = np.empty((len(beams), 3))
    for ring in range(len(beams)):
        x = beams[ring, 0] * (ca * beams[ring, 2] - sa * beams[ring, 3])
        y = beams[ring, 0] * (sa * beams[ring, 2] + ca * beams[ring, 3])
        z = beams[ring, 1]
        for axis in range(3):
            rays[ring, axis] = r[axis, 0] * x + r[axis, 1] * y + r[axis, 2] * z
    return rays


@njit(cache=True)
def _enter_frames(
    scan: Scan, world: World, chosen: NDArray[np.int64], column: int, near: NDArray[np.float64]
) -> None:
    """Fills one row per candidate: all that the beams of a column need to know, side by side."""
    solids, materials = world.solids, world.materials
    for i in range(len(chosen)):
        p = chosen[i]
        x, y, z, yaw = solid_pose_at(solids, p, scan.time_s[column])
        dx, dy = scan.origin_m[column, 0] - x, scan.origin_m[column, 1] - y
        c, s = np.cos(yaw), np.sin(yaw)
        row, material = near[i], solids.material[p]
        row[0], row[1], row[2] = c * dx + s * dy, c * dy - s * dx, scan.origin_m[column, 2] - z
        row[_TURN], row[_TURN + 1] = c, s
        row[_HALF : _HALF + 3] = solids.half_m[p]
        row[_CUTS : _CUTS + 2] = solids.chamfer_m[p]
        row[_KIND], row[_OPACITY] = solids.kind[p], materials.opacity[material]
        row[_DENSITY], row[_CLUMPED] = materials.density_per_m[material], materials.clumped[material]
        row[_PITCH], row[_SHARE] = materials.window_pitch_m[material], materials.window_share[material]
        row[_MATERIAL], row[_NUMBER] = material, p
        away, radius = np.hypot(dx, dy), np.hypot(row[_HALF], row[_HALF + 1])
        row[_FIRST], row[_LAST] = away - radius, away + radius


@njit(cache=True, error_model="numpy")
def _first_solids(
    near: NDArray[np.float64], rays: NDArray[np.float64], seed: np.uint64, limit_m: float
) -> NDArray[np.float64]:
    """(R, 4) per beam: range, cosine, row of the candidate met first, its material."""
    met = np.empty((len(rays), 4))
    for ring in range(len(rays)):
        ray, key = (rays[ring, 0], rays[ring, 1], rays[ring, 2]), mix(seed, ring)
        best, cosine, index = limit_m, 0.0, _NOTHING
        flat = np.sqrt(1.0 - ray[2] * ray[2])
        rise = ray[2] / flat
        for i in range(len(near)):
            if near[i, _BOUND] > best:
                break
            if _passes_over_or_under(near, i, rise):
                continue
            t, slant = _meet(near, i, key, (ray, best))
            if t < best:
                best, cosine, index = t, slant, i
        met[ring, 0], met[ring, 1], met[ring, 2] = best, cosine, index
        met[ring, 3] = near[index, _MATERIAL] if index >= 0 else 0.0
    return met


@njit(cache=True)
def _passes_over_or_under(near: NDArray[np.float64], i: int, rise: float) -> bool:
    """Whether a beam that climbs ``rise`` per metre of way is clear of a candidate's heights."""
    at_first = near[i, 2] + rise * max(near[i, _FIRST], 0.0)
    at_last = near[i, 2] + rise * near[i, _LAST]
    top = near[i, _HALF + 2]
    return min(at_first, at_last) > top or max(at_first, at_last) < -top


@njit(cache=True)
def _keep_nearest(
    terrain: Terrain,
    sensor_m: NDArray[np.float64],
    rays: NDArray[np.float64],
    met: NDArray[np.float64],
) -> None:
    """Replaces what lies behind the ground by the ground."""
    origin = (sensor_m[0], sensor_m[1], sensor_m[2])
    heights, frame = terrain.height_m, terrain.frame
    for ring in range(len(rays)):
        ray = (rays[ring, 0], rays[ring, 1], rays[ring, 2])
        t = hit_ground((heights, frame, terrain.slope), origin, ray, met[ring, 0])
        if t < met[ring, 0]:
            x, y = origin[0] + t * ray[0], origin[1] + t * ray[1]
            met[ring, 0], met[ring, 1] = t, ground_cosine(heights, frame, (x, y), ray)
            met[ring, 2], met[ring, 3] = GROUND, surface_at(terrain.surface, frame, x, y)


@njit(cache=True, error_model="numpy")
def _meet(
    near: NDArray[np.float64], i: int, key: np.uint64, beam: tuple[Vector, float]
) -> tuple[float, float]:
    """(range, cosine) at which a beam comes back from one candidate; range inf if it does not."""
    ray, best = beam
    c, s = near[i, _TURN], near[i, _TURN + 1]
    origin = (near[i, 0], near[i, 1], near[i, 2])
    direction = (c * ray[0] + s * ray[1], c * ray[1] - s * ray[0], ray[2])
    enter, leave, cosine = _geometry(near, i, origin, direction)
    if enter > leave or enter > best or leave <= 0.0:
        return np.inf, 0.0
    bits, opacity = mix(key, int(near[i, _NUMBER])), near[i, _OPACITY]
    chord = Chord(bits, enter, leave)
    if enter > 0.0 and (opacity >= 1.0 or unit(bits) < opacity):
        if near[i, _PITCH] > 0.0:
            windows = (near[i, _PITCH], near[i, _SHARE])
            return window_return(windows, chord, origin, direction, cosine)
        return enter, cosine
    if near[i, _DENSITY] > 0.0:
        leaves = (near[i, _DENSITY], near[i, _CLUMPED] > 0.0)
        return inside_return(leaves, chord, origin, direction, best), _LEAF_COSINE
    return np.inf, 0.0


@njit(cache=True, error_model="numpy")
def _geometry(near: NDArray[np.float64], i: int, origin: Vector, direction: Vector) -> Hit:
    half = (near[i, _HALF], near[i, _HALF + 1], near[i, _HALF + 2])
    kind = int(near[i, _KIND])
    if kind == BOX:
        return hit_box(origin, direction, half, (near[i, _CUTS], near[i, _CUTS + 1]))
    if kind == CYLINDER:
        return hit_cylinder(origin, direction, half)
    return hit_ellipsoid(origin, direction, half)


def owners(returns: Returns, solids: Solids) -> NDArray[np.int64]:
    """(C, R) row of the mover that each beam met, BACKGROUND elsewhere."""
    met = returns.solid >= 0
    return np.where(met, solids.owner[np.where(met, returns.solid, 0)], BACKGROUND)
