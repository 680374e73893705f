"""Materials: which share of beams a surface returns, and how beams pass leaves, glass and windows.

No measurement stands behind the numbers below. They were chosen by eye so that the point clouds
look like recorded ones: glass and fences are seen through, hedges and crowns return from inside,
the windows of facades leave gaps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, Mask
from mottrack.world.hashing import random_bits, uniform
from mottrack.world.intersect import Hit, Vector

(
    PLAIN, PAINT, GLASS, FOLIAGE, HEDGE, FENCE, FACADE, SIGN, CLOTH, FRAME, ASPHALT, CONCRETE,
    GRASS, SHOPFRONT,
) = range(14)  # fmt: skip

# leaves: clumps of a twig's size whose density is peak * u^1.5 of a uniform u, so 1 in the mean
_CLUMP_M = 0.35
_CLUMP_PEAK = 2.5
_CLUMP_SEED = np.uint64(977)  # arbitrary
_MAX_STEPS = 24
"""Rejections before a beam counts as through; some ten are usual for a crown of 10 m."""

# facades: windows between 0.3 and 0.8 of a storey; a curtain or reveal returns 15 to 65 % of the
# beams, of the others up to 80 % in all are mirrored away and the rest returns from the room
_STOREY_M = 3.0
_SILL, _LINTEL = 0.3, 0.8
_LEAST_CURTAIN, _CURTAIN_SPREAD = 0.15, 0.5
_MIRRORED_UP_TO = 0.8
_INTERIOR_M = 1.3  # Mean depth of a return from a room
_PANE_SEED = np.uint64(31)  # arbitrary


class Surface(NamedTuple):
    """Surface of a solid."""

    material: int
    albedo: float
    """Diffuse reflectivity in [0, 1]."""


class Materials(NamedTuple):
    """Table of M materials, named tuple of arrays for numba."""

    opacity: F64
    """(M,) share of beams that the outer surface returns."""
    density_per_m: F64
    """(M,) inside, the rate of the exponential free path of beams that entered."""
    clumped: Mask
    """(M,) whether the density inside varies from place to place, as leaves do."""
    window_pitch_m: F64
    """(M,) distance of the windows of a facade; 0: none."""
    window_share: F64
    """(M,) width of a window over the pitch."""
    mirror: F64
    """(M,) share of beams lost by specular reflection at grazing incidence."""
    speckle: F64
    """(M,) relative deviation of the reflectance from point to point."""


def material_table() -> Materials:
    """Return the materials of the embedded world, in the order of this module's names."""
    rows = [
        # opacity density clumped pitch share mirror speckle
        [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.25],  # PLAIN
        [0.99, 0.0, 0, 0.0, 0.0, 0.12, 0.35],  # PAINT
        [0.35, 0.5, 0, 0.0, 0.0, 0.25, 0.50],  # GLASS
        [0.00, 1.1, 1, 0.0, 0.0, 0.00, 0.50],  # FOLIAGE
        [0.25, 4.0, 1, 0.0, 0.0, 0.00, 0.45],  # HEDGE
        [0.28, 0.0, 0, 0.0, 0.0, 0.00, 0.35],  # FENCE
        [1.00, 0.0, 0, 2.6, 0.5, 0.00, 0.20],  # FACADE
        [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.05],  # SIGN
        [0.98, 0.0, 0, 0.0, 0.0, 0.00, 0.35],  # CLOTH
        [0.45, 0.0, 0, 0.0, 0.0, 0.10, 0.50],  # FRAME
        [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.35],  # ASPHALT
        [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.25],  # CONCRETE
        [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.50],  # GRASS
        [1.00, 0.0, 0, 3.2, 0.8, 0.00, 0.25],  # SHOPFRONT
    ]
    columns = np.array(rows).T.copy()
    return Materials(*columns)._replace(clumped=columns[2] > 0)


class Beam(NamedTuple):
    """One beam in the frame of a solid that it meets."""

    bits: np.uint64
    """Random bits of this beam at this solid."""
    origin: Vector
    direction: Vector
    hit: Hit


@compiled
def inside_return(density_per_m: float, clumped: bool, beam: Beam, limit_m: float) -> float:
    """Return the range at which a beam comes back from within a porous solid, inf if it does not.

    Exponential free path; where the density varies, by rejection (Woodcock tracking).

    Args:
        density_per_m: mean density inside.
        clumped: whether it varies from place to place.
        beam: the beam and the part of it inside the solid.
        limit_m: range beyond which the answer does not matter.
    """
    density = density_per_m * _CLUMP_PEAK if clumped else density_per_m
    t, end = max(beam.hit.near_m, 0.0), min(beam.hit.far_m, limit_m)
    for step in range(_MAX_STEPS):
        t -= np.log(uniform(random_bits(beam.bits, 2 * step + 1))) / density
        if t >= end:
            return np.inf
        accept = uniform(random_bits(beam.bits, 2 * step + 2)) * _CLUMP_PEAK
        if not clumped or accept < _clump(beam.origin, beam.direction, t):
            return float(t)
    return np.inf


@compiled
def _clump(origin: Vector, direction: Vector, t: float) -> float:
    """Return the relative density at a place: clumps are fixed in the solid's frame."""
    i = int(np.floor((origin.x + t * direction.x) / _CLUMP_M))
    j = int(np.floor((origin.y + t * direction.y) / _CLUMP_M))
    k = int(np.floor((origin.z + t * direction.z) / _CLUMP_M))
    # one number a cell: ten bits an axis, 180 m either way
    u = uniform(random_bits(_CLUMP_SEED, (i + 512) * 1048576 + (j + 512) * 1024 + k + 512))
    return float(_CLUMP_PEAK * u * np.sqrt(u))


@compiled(error_model="numpy")
def window_return(pitch_m: float, share: float, beam: Beam) -> tuple[float, float]:
    """Return (range, cosine) from a facade: its wall, a room behind a window, or cosine 0: lost.

    Args:
        pitch_m: distance of the windows.
        share: their width over it.
        beam: the beam, which meets the wall at its near end.
    """
    origin, direction, (enter, _, cosine) = beam.origin, beam.direction, beam.hit
    along = (origin.x + enter * direction.x + origin.y + enter * direction.y) / pitch_m
    storey = (origin.z + enter * direction.z) / _STOREY_M
    across, up = along - np.floor(along), storey - np.floor(storey)
    if across > share or up < _SILL or up > _LINTEL:
        return enter, cosine
    pane = random_bits(_PANE_SEED, int(np.floor(along)) * 4096 + int(np.floor(storey)))
    curtain = _LEAST_CURTAIN + _CURTAIN_SPREAD * uniform(pane)
    u = uniform(random_bits(beam.bits, 1))
    if u < curtain * cosine:
        return enter, cosine
    if u < _MIRRORED_UP_TO:
        return enter, 0.0
    return enter - _INTERIOR_M * np.log(uniform(random_bits(beam.bits, 2))), 0.5
