"""Ray casting: the beams of one revolution of a LiDAR against solids and ground.

A beam hits the nearest thing only (true occlusion). Things that let beams through draw from a
counter-based generator keyed by beam and solid, so the result does not depend on any order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I16, I64
from mottrack.world.culling import Candidates, ScanPattern, find_candidates
from mottrack.world.hashing import random_bits, uniform
from mottrack.world.intersect import Hit, Vector, hit_box, hit_cylinder, hit_ellipsoid
from mottrack.world.materials import Beam, Materials, inside_return, window_return
from mottrack.world.solids import BOX, CYLINDER, Solids, solid_pose_at
from mottrack.world.terrain import Beams, Terrain, ground_cosine, ground_ranges, surface_at

GROUND = -2
_NOTHING = -3
_LEAF_COSINE = 0.6
"""Leaves in all directions: the mean |cosine| is 1/2, weighted by visible area 2/3."""
_SAME_AZIMUTH_PER_RAD = 2000.0
"""Beams whose offsets round to the same 0.5 mrad share a section through the ground."""

# Columns of the table of solids (P, _FIELDS). What decides most often stands in front, in one
# cache line: place of the sensor in world axes (x, y), radius, height of the sensor over the
# middle, distance to the near and far side, half height.
_AWAY, _RADIUS, _HEIGHT, _FIRST, _LAST, _TOP = 0, 2, 3, 4, 5, 6
# place of the sensor in the solid's frame (x, y), cosine and sine of its yaw, half extents,
# chamfers, shape, material
_PLACE, _YAW, _HALF, _CHAMFER, _KIND, _OPACITY, _DENSITY = 8, 10, 12, 15, 17, 18, 19
_CLUMPED, _PITCH, _SHARE, _MATERIAL, _FIELDS = 20, 21, 22, 23, 24


class SceneGeometry(NamedTuple):
    """All that a beam can hit; named tuple for numba."""

    solids: Solids
    materials: Materials
    terrain: Terrain


class Returns(NamedTuple):
    """What each beam hit, arrays (C, R) or, of one column, (R,)."""

    range_m: F64
    """inf where nothing was hit."""
    solid: I64
    """Row of the solid hit, ``GROUND``, or below where nothing was hit."""
    material: I16
    cosine: F64
    """Cosine of incidence; 0 for a beam that was mirrored away."""


def cast(scan: ScanPattern, scene: SceneGeometry, seed: int) -> Returns:
    """Return what every beam of ``scan`` hits; the same for the same seed."""
    return _cast(scan, scene, find_candidates(scan, scene.solids), np.uint64(seed))


@compiled(error_model="numpy")
def _cast(
    scan: ScanPattern, scene: SceneGeometry, candidates: Candidates, seed: np.uint64
) -> Returns:
    columns, rings = len(scan.time_s), len(scan.elevation_rad)
    returns = Returns(
        np.full((columns, rings), scan.max_range_m),
        np.full((columns, rings), _NOTHING),
        np.zeros((columns, rings), np.int16),
        np.zeros((columns, rings)),
    )
    beams = Beams(
        np.empty((rings, 3)), np.empty((rings, 2)), np.empty(rings), _groups(scan.offset_rad)
    )
    angles, table = _angles(scan), _describe(scene)
    for column in range(columns):
        chosen = candidates.solid[candidates.start[column] : candidates.start[column + 1]]
        hits = Returns(
            returns.range_m[column],
            returns.solid[column],
            returns.material[column],
            returns.cosine[column],
        )
        _enter_frames(scan, scene.solids, chosen, column, table)
        _aim(scan, angles, column, beams)
        _first_solids(table, chosen, beams, random_bits(seed, column), hits)
        _keep_nearest(scene.terrain, scan.origin_m[column], beams, hits)
        for ring in range(rings):
            if hits.solid[ring] == _NOTHING:
                hits.range_m[ring] = np.inf
    return returns


@compiled
def _groups(offset_rad: F64) -> I64:
    """Return (R,) the azimuth group of each beam."""
    rounded = np.rint(offset_rad * _SAME_AZIMUTH_PER_RAD)
    return np.searchsorted(np.unique(rounded), rounded).astype(np.int64)


@compiled
def _angles(scan: ScanPattern) -> F64:
    """Return (R, 4) cosine and sine of the elevation and of the azimuth offset of each beam."""
    angles = np.empty((len(scan.elevation_rad), 4))
    for ring in range(len(angles)):
        elevation, offset = scan.elevation_rad[ring], scan.offset_rad[ring]
        angles[ring, 0], angles[ring, 1] = np.cos(elevation), np.sin(elevation)
        angles[ring, 2], angles[ring, 3] = np.cos(offset), np.sin(offset)
    return angles


@compiled
def _aim(scan: ScanPattern, angles: F64, column: int, beams: Beams) -> None:
    """Fill in the directions of the beams of a column."""
    ca, sa = np.cos(scan.azimuth_rad[column]), np.sin(scan.azimuth_rad[column])
    r, direction = scan.rotation[column], beams.direction
    for ring in range(len(angles)):
        x = angles[ring, 0] * (ca * angles[ring, 2] - sa * angles[ring, 3])
        y = angles[ring, 0] * (sa * angles[ring, 2] + ca * angles[ring, 3])
        z = angles[ring, 1]
        for axis in range(3):
            direction[ring, axis] = r[axis, 0] * x + r[axis, 1] * y + r[axis, 2] * z
        per_metre = 1.0 / np.sqrt(1.0 - direction[ring, 2] * direction[ring, 2])
        beams.horizontal[ring, 0] = direction[ring, 0] * per_metre
        beams.horizontal[ring, 1] = direction[ring, 1] * per_metre
        beams.climb[ring] = direction[ring, 2] * per_metre


@compiled
def _describe(scene: SceneGeometry) -> F64:
    """Return (P, _FIELDS) what beams of any column need of each solid, side by side."""
    solids, materials = scene.solids, scene.materials
    table = np.empty((len(solids.kind), _FIELDS))
    for p in range(len(table)):
        row, material = table[p], solids.material[p]
        row[_YAW], row[_YAW + 1] = np.cos(solids.yaw_rad[p]), np.sin(solids.yaw_rad[p])
        for axis in range(3):
            row[_HALF + axis] = solids.half_m[p, axis]
        for k in range(2):
            row[_CHAMFER + k] = solids.chamfer_m[p, k]
        row[_KIND], row[_MATERIAL] = solids.kind[p], material
        row[_OPACITY], row[_DENSITY] = (
            materials.opacity[material],
            materials.density_per_m[material],
        )
        row[_CLUMPED], row[_PITCH] = materials.clumped[material], materials.window_pitch_m[material]
        row[_SHARE], row[_TOP] = materials.window_share[material], row[_HALF + 2]
        row[_RADIUS] = np.hypot(row[_HALF], row[_HALF + 1])
    return table


@compiled
def _enter_frames(scan: ScanPattern, solids: Solids, chosen: I64, column: int, table: F64) -> None:
    """Complete the rows of the chosen solids by where the sensor is in their frames."""
    time, sensor, rates = scan.time_s[column], scan.origin_m[column], solids.yaw_rate_radps
    for p in chosen:
        x, y, z, yaw = solid_pose_at(solids, p, time)
        dx, dy = sensor[0] - x, sensor[1] - y
        row = table[p]
        if rates[p] != 0.0:
            row[_YAW], row[_YAW + 1] = np.cos(yaw), np.sin(yaw)
        c, s = row[_YAW], row[_YAW + 1]
        row[_PLACE], row[_PLACE + 1] = c * dx + s * dy, c * dy - s * dx
        row[_AWAY], row[_AWAY + 1], row[_HEIGHT] = dx, dy, sensor[2] - z
        away, radius = np.sqrt(dx * dx + dy * dy), row[_RADIUS]
        row[_FIRST], row[_LAST] = max(away - radius, 0.0), away + radius


@compiled(error_model="numpy")
def _first_solids(table: F64, chosen: I64, beams: Beams, seed: np.uint64, hits: Returns) -> None:
    """Fill in the solid that each beam of a column hits first.

    Solids outside, beams inside: few of the beams of a column are at the height of a given solid.
    """
    slack, climb, horizontal = _disorder(beams.climb), beams.climb, beams.horizontal
    for p in chosen:
        low, high = _climbs(table, p)
        ring = int(np.searchsorted(climb, low - 2.0 * slack))
        while ring < len(climb) and climb[ring] <= high + slack:
            aside = (
                horizontal[ring, 0] * table[p, _AWAY + 1] - horizontal[ring, 1] * table[p, _AWAY]
            )
            nearest = hits.range_m[ring]
            if abs(aside) <= table[p, _RADIUS] and table[p, _FIRST] < nearest:
                bits = random_bits(random_bits(seed, ring), p)
                t, cosine = _meet(table, p, bits, _ray(beams, ring), nearest)
                if t < nearest:
                    hits.range_m[ring], hits.cosine[ring], hits.solid[ring] = t, cosine, p
                    hits.material[ring] = int(table[p, _MATERIAL])
            ring += 1


@compiled
def _ray(beams: Beams, ring: int) -> Vector:
    direction = beams.direction
    return Vector(direction[ring, 0], direction[ring, 1], direction[ring, 2])


@compiled
def _disorder(climb: F64) -> float:
    """Return by how much a beam climbs less than one below it, as those of a tilted sensor do."""
    slack, most = 0.0, -np.inf
    for value in climb:
        most = max(most, value)
        slack = max(slack, most - value)
    return slack


@compiled(error_model="numpy")
def _climbs(table: F64, p: int) -> tuple[float, float]:
    """Return the rises per horizontal metre between which a beam can hit a solid."""
    first, last = table[p, _FIRST], table[p, _LAST]
    if first <= 0.0:
        return -np.inf, np.inf
    below, above = -table[p, _TOP] - table[p, _HEIGHT], table[p, _TOP] - table[p, _HEIGHT]
    return min(below / first, below / last), max(above / first, above / last)


@compiled
def _keep_nearest(terrain: Terrain, sensor_m: F64, beams: Beams, hits: Returns) -> None:
    """Replace what lies behind the ground by the ground."""
    for group in range(beams.azimuth_group.max() + 1):
        ranges = ground_ranges(terrain, sensor_m, beams, group, hits.range_m)
        for ring in range(len(ranges)):
            t = ranges[ring]
            if beams.azimuth_group[ring] == group and t < hits.range_m[ring]:
                ray = _ray(beams, ring)
                x, y = sensor_m[0] + t * ray.x, sensor_m[1] + t * ray.y
                hits.range_m[ring], hits.solid[ring] = t, GROUND
                hits.cosine[ring] = ground_cosine(terrain, x, y, ray)
                hits.material[ring] = surface_at(terrain.surface, terrain.frame, x, y)


@compiled(error_model="numpy")
def _meet(table: F64, p: int, bits: np.uint64, ray: Vector, limit_m: float) -> tuple[float, float]:
    """Return (range, cosine) at which a beam returns from one solid; inf if it does not."""
    c, s = table[p, _YAW], table[p, _YAW + 1]
    origin = Vector(table[p, _PLACE], table[p, _PLACE + 1], table[p, _HEIGHT])
    direction = Vector(c * ray.x + s * ray.y, c * ray.y - s * ray.x, ray.z)
    hit = _geometry(table, p, origin, direction)
    if hit.near_m > hit.far_m or hit.near_m > limit_m or hit.far_m <= 0.0:
        return np.inf, 0.0
    opacity, beam = table[p, _OPACITY], Beam(bits, origin, direction, hit)
    if hit.near_m > 0.0 and (opacity >= 1.0 or uniform(bits) < opacity):
        if table[p, _PITCH] > 0.0:
            return window_return(table[p, _PITCH], table[p, _SHARE], beam)
        return hit.near_m, hit.cosine
    if table[p, _DENSITY] > 0.0:
        clumped = table[p, _CLUMPED] > 0.0
        return inside_return(table[p, _DENSITY], clumped, beam, limit_m), _LEAF_COSINE
    return np.inf, 0.0


@compiled(error_model="numpy")
def _geometry(table: F64, p: int, origin: Vector, direction: Vector) -> Hit:
    half, kind = (
        Vector(table[p, _HALF], table[p, _HALF + 1], table[p, _HALF + 2]),
        int(table[p, _KIND]),
    )
    if kind == BOX:
        return hit_box(origin, direction, half, (table[p, _CHAMFER], table[p, _CHAMFER + 1]))
    if kind == CYLINDER:
        return hit_cylinder(origin, direction, half)
    return hit_ellipsoid(origin, direction, half)
