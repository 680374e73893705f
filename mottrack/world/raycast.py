"""Casts the beams of one turn of a LiDAR against solids and ground.

A beam meets the nearest thing only (true occlusion). Things that let beams through draw from a
counter-based generator keyed by beam and solid, so the result does not depend on any order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I16, I64
from mottrack.world.culling import Candidates, Scan, find_candidates, solid_pose_at
from mottrack.world.hashing import mix, unit
from mottrack.world.intersect import (
    Hit,
    Vector,
    hit_box,
    hit_cylinder,
    hit_ellipsoid,
)
from mottrack.world.materials import Materials
from mottrack.world.porous import Chord, inside_return, window_return
from mottrack.world.solids import BACKGROUND, BOX, CYLINDER, Solids
from mottrack.world.terrain import Terrain, ground_cosine, ground_walk, surface_at

GROUND = -2
_NOTHING = -3
_LEAF_COSINE = 0.6
# columns of the table of candidates; what decides most often stands in front, in one cache line
_AWAY, _RADIUS, _HEIGHT, _FIRST, _LAST, _TOP = 0, 2, 3, 4, 5, 6
_PLACE, _TURN, _HALF, _CUTS, _KIND, _OPACITY, _DENSITY = 8, 10, 12, 15, 17, 18, 19
_CLUMPED, _PITCH, _SHARE, _MATERIAL, _NUMBER, _FIELDS = 20, 21, 22, 23, 24, 25


class World(NamedTuple):
    """All that a beam can meet; named tuple for numba."""

    solids: Solids
    materials: Materials
    terrain: Terrain


class Returns(NamedTuple):
    """What each beam met, (C, R) arrays; range is inf where it met nothing."""

    range_m: F64
    solid: I64
    """Row of the solid met, ``GROUND``, or below where nothing was met."""
    material: I16
    cosine: F64
    """Cosine of incidence; 0 for a beam that was mirrored away."""


def cast(scan: Scan, world: World, seed: int) -> Returns:
    """What every beam of ``scan`` meets in ``world``, the same for the same seed."""
    candidates = find_candidates(scan, world.solids)
    returns: Returns = _cast(scan, world, candidates, np.uint64(seed))
    return returns


@compiled(error_model="numpy")
def _cast(scan: Scan, world: World, candidates: Candidates, seed: np.uint64) -> Returns:
    columns, rings = len(scan.time_s), len(scan.elevation_rad)
    returns = Returns(
        np.full((columns, rings), np.inf),
        np.full((columns, rings), _NOTHING),
        np.zeros((columns, rings), np.int16),
        np.zeros((columns, rings)),
    )
    beams, stands = _beams(scan), _columns_of_beams(scan.offset_rad)
    table, rays, met = _describe(world), np.empty((rings, 6)), np.empty((rings, 4))
    for column in range(columns):
        chosen = candidates.solid[candidates.start[column] : candidates.start[column + 1]]
        _enter_frames(scan, world.solids, chosen, column, table)
        _directions(scan, beams, column, rays)
        met[:, 0], met[:, 1], met[:, 2], met[:, 3] = scan.max_range_m, 0.0, _NOTHING, 0.0
        _first_solids(table, chosen, rays, mix(seed, column), met)
        _keep_nearest(world.terrain, scan.origin_m[column], rays, stands, met)
        for ring in range(rings):
            solid = int(met[ring, 2])
            if solid == _NOTHING:
                continue
            returns.range_m[column, ring], returns.cosine[column, ring] = met[ring, 0], met[ring, 1]
            returns.material[column, ring], returns.solid[column, ring] = int(met[ring, 3]), solid
    return returns


@compiled
def _columns_of_beams(offset_rad: F64) -> I64:
    """(R,) which of the beams stand over each other: equal numbers, equal azimuth."""
    different = np.unique(np.rint(offset_rad * 2000.0))
    return np.searchsorted(different, np.rint(offset_rad * 2000.0)).astype(np.int64)


@compiled
def _beams(scan: Scan) -> F64:
    """(R, 4) cosine and sine of the elevation and of the azimuth offset of each beam."""
    beams = np.empty((len(scan.elevation_rad), 4))
    beams[:, 0], beams[:, 1] = np.cos(scan.elevation_rad), np.sin(scan.elevation_rad)
    beams[:, 2], beams[:, 3] = np.cos(scan.offset_rad), np.sin(scan.offset_rad)
    return beams


@compiled
def _directions(scan: Scan, beams: F64, column: int, rays: F64) -> None:
    """Fills (R, 6): direction of each beam in the world; x, y and climb per metre of way."""
    ca, sa = np.cos(scan.azimuth_rad[column]), np.sin(scan.azimuth_rad[column])
    r = scan.rotation[column]
    for ring in range(len(beams)):
        x = beams[ring, 0] * (ca * beams[ring, 2] - sa * beams[ring, 3])
        y = beams[ring, 0] * (sa * beams[ring, 2] + ca * beams[ring, 3])
        z = beams[ring, 1]
        for axis in range(3):
            rays[ring, axis] = r[axis, 0] * x + r[axis, 1] * y + r[axis, 2] * z
        per_metre = 1.0 / np.sqrt(1.0 - rays[ring, 2] * rays[ring, 2])
        for axis in range(3):
            rays[ring, 3 + axis] = rays[ring, axis] * per_metre


@compiled
def _describe(world: World) -> F64:
    """(P, _FIELDS) what the beams of any column need to know of each solid, side by side."""
    solids, materials = world.solids, world.materials
    table = np.empty((len(solids.kind), _FIELDS))
    for p in range(len(table)):
        row, material = table[p], solids.material[p]
        row[_TURN], row[_TURN + 1] = np.cos(solids.yaw_rad[p]), np.sin(solids.yaw_rad[p])
        for axis in range(3):
            row[_HALF + axis] = solids.half_m[p, axis]
        row[_CUTS], row[_CUTS + 1] = solids.chamfer_m[p, 0], solids.chamfer_m[p, 1]
        row[_KIND], row[_OPACITY] = solids.kind[p], materials.opacity[material]
        row[_DENSITY], row[_CLUMPED] = (
            materials.density_per_m[material],
            materials.clumped[material],
        )
        row[_PITCH], row[_SHARE] = (
            materials.window_pitch_m[material],
            materials.window_share[material],
        )
        row[_MATERIAL], row[_NUMBER], row[_TOP] = material, p, row[_HALF + 2]
        row[_RADIUS] = np.hypot(row[_HALF], row[_HALF + 1])
    return table


@compiled
def _enter_frames(
    scan: Scan,
    solids: Solids,
    chosen: I64,
    column: int,
    table: F64,
) -> None:
    """Completes the rows of the chosen solids by where the sensor is in their frames."""
    time, sensor, rates = scan.time_s[column], scan.origin_m[column], solids.yaw_rate_radps
    for p in chosen:
        x, y, z, yaw = solid_pose_at(solids, p, time)
        dx, dy = sensor[0] - x, sensor[1] - y
        row = table[p]
        if rates[p] != 0.0:
            row[_TURN], row[_TURN + 1] = np.cos(yaw), np.sin(yaw)
        c, s = row[_TURN], row[_TURN + 1]
        row[_PLACE], row[_PLACE + 1] = c * dx + s * dy, c * dy - s * dx
        row[_AWAY], row[_AWAY + 1], row[_HEIGHT] = dx, dy, sensor[2] - z
        away, radius = np.sqrt(dx * dx + dy * dy), row[_RADIUS]
        row[_FIRST], row[_LAST] = max(away - radius, 0.0), away + radius


@compiled(error_model="numpy")
def _first_solids(
    near: F64,
    chosen: I64,
    rays: F64,
    seed: np.uint64,
    met: F64,
) -> None:
    """Fills (R, 4) per beam: range, cosine, the solid met first, its material.

    Solids outside, beams inside: of a fan of beams few have the height of a given solid.
    """
    slack = _disorder(rays)
    for p in chosen:
        low, high = _climbs(near[p, _HEIGHT], near[p, _TOP], near[p, _FIRST], near[p, _LAST])
        ring = _first_beam(rays, low - 2.0 * slack)
        while ring < len(rays) and rays[ring, 5] <= high + slack:
            aside = rays[ring, 3] * near[p, _AWAY + 1] - rays[ring, 4] * near[p, _AWAY]
            if abs(aside) <= near[p, _RADIUS] and near[p, _FIRST] < met[ring, 0]:
                ray = (rays[ring, 0], rays[ring, 1], rays[ring, 2])
                t, cosine = _meet(near, p, mix(seed, ring), (ray, met[ring, 0]))
                if t < met[ring, 0]:
                    met[ring, 0], met[ring, 1], met[ring, 2] = t, cosine, p
                    met[ring, 3] = near[p, _MATERIAL]
            ring += 1


@compiled
def _disorder(rays: F64) -> float:
    """By how much a beam climbs less than one below it, as those of a tilted sensor do."""
    slack, most = 0.0, -np.inf
    for ring in range(len(rays)):
        most = max(most, rays[ring, 5])
        slack = max(slack, most - rays[ring, 5])
    return slack


@compiled
def _first_beam(rays: F64, climb: float) -> int:
    """A beam below which none climbs ``climb``, by halving; right up to the disorder."""
    low, high = 0, len(rays)
    while low < high:
        middle = (low + high) // 2
        if rays[middle, 5] < climb:
            low = middle + 1
        else:
            high = middle
    return low


@compiled(error_model="numpy")
def _climbs(height: float, top: float, first: float, last: float) -> tuple[float, float]:
    """Climbs per metre between which a beam can meet a solid ``first`` to ``last`` metres away.

    ``height`` is that of the sensor over the middle of the solid, ``top`` its half height.
    """
    if first <= 0.0:
        return -np.inf, np.inf
    below, above = -top - height, top - height
    return min(below / first, below / last), max(above / first, above / last)


@compiled
def _keep_nearest(
    terrain: Terrain,
    sensor_m: F64,
    rays: F64,
    stands: I64,
    met: F64,
) -> None:
    """Replaces what lies behind the ground by the ground."""
    heights, surface = terrain.height_m, terrain.surface
    for stand in range(stands.max() + 1):
        walk = ground_walk(heights, terrain.frame, sensor_m, rays, (stands, stand, met[:, 0]))
        for ring in range(len(rays)):
            t = walk[ring]
            if stands[ring] == stand and t < met[ring, 0]:
                ray = (rays[ring, 0], rays[ring, 1], rays[ring, 2])
                x, y = sensor_m[0] + t * ray[0], sensor_m[1] + t * ray[1]
                met[ring, 0] = t
                met[ring, 1] = ground_cosine(heights, terrain.frame, (x, y), ray)
                met[ring, 2] = GROUND
                met[ring, 3] = surface_at(surface, terrain.frame, x, y)


@compiled(error_model="numpy")
def _meet(near: F64, i: int, key: np.uint64, beam: tuple[Vector, float]) -> tuple[float, float]:
    """(range, cosine) at which a beam comes back from one candidate; range inf if it does not."""
    ray, best = beam
    c, s = near[i, _TURN], near[i, _TURN + 1]
    origin = (near[i, _PLACE], near[i, _PLACE + 1], near[i, _HEIGHT])
    direction = (c * ray[0] + s * ray[1], c * ray[1] - s * ray[0], ray[2])
    enter, leave, cosine = _geometry(near, i, origin, direction)
    if enter > leave or enter > best or leave <= 0.0:
        return np.inf, 0.0
    bits, opacity = mix(key, int(near[i, _NUMBER])), near[i, _OPACITY]
    chord = Chord(bits, enter, leave)
    if enter > 0.0 and (opacity >= 1.0 or unit(bits) < opacity):
        if near[i, _PITCH] > 0.0:
            windows = (near[i, _PITCH], near[i, _SHARE])
            enter, cosine = window_return(windows, chord, origin, direction, cosine)
        return enter, cosine
    if near[i, _DENSITY] > 0.0:
        leaves = (near[i, _DENSITY], near[i, _CLUMPED] > 0.0)
        return inside_return(leaves, chord, origin, direction, best), _LEAF_COSINE
    return np.inf, 0.0


@compiled(error_model="numpy")
def _geometry(near: F64, i: int, origin: Vector, direction: Vector) -> Hit:
    half = (near[i, _HALF], near[i, _HALF + 1], near[i, _HALF + 2])
    kind = int(near[i, _KIND])
    if kind == BOX:
        hit: Hit = hit_box(origin, direction, half, (near[i, _CUTS], near[i, _CUTS + 1]))
    elif kind == CYLINDER:
        hit = hit_cylinder(origin, direction, half)
    else:
        hit = hit_ellipsoid(origin, direction, half)
    return hit


def owners(returns: Returns, solids: Solids) -> I64:
    """(C, R) row of the mover that each beam met, BACKGROUND elsewhere."""
    met = returns.solid >= 0
    return np.where(met, solids.owner[np.where(met, returns.solid, 0)], BACKGROUND)
