"""Beams in leaves, behind glass and in windows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.world.hashing import mix, unit
from mottrack.world.intersect import Vector

_CLUMP_M = 0.35
_CLUMP_PEAK = 2.5
_MAX_STEPS = 24
_STOREY_M = 3.0
_INTERIOR_M = 1.3


class Chord(NamedTuple):
    """Random bits of one beam at one solid, and the part of the beam inside the solid."""

    bits: np.uint64
    enter_m: float
    leave_m: float


@compiled
def _clump(origin: Vector, direction: Vector, t: float) -> float:
    """Relative density at a place: leaves hang in clumps, fixed in the solid's frame."""
    i = int(np.floor((origin[0] + t * direction[0]) / _CLUMP_M))
    j = int(np.floor((origin[1] + t * direction[1]) / _CLUMP_M))
    k = int(np.floor((origin[2] + t * direction[2]) / _CLUMP_M))
    u = unit(mix(np.uint64(977), (i + 512) * 1048576 + (j + 512) * 1024 + k + 512))
    return float(_CLUMP_PEAK * u * np.sqrt(u))


@compiled
def inside_return(
    leaves: tuple[float, bool], chord: Chord, origin: Vector, direction: Vector, limit_m: float
) -> float:
    """Range at which a beam is sent back inside a porous solid, inf if it gets through.

    Exponential free path; where the density varies, by rejection (Woodcock tracking).

    Args:
        leaves: mean density per metre, and whether it varies from place to place.
        chord: the draw and the part of the beam inside the solid.
        origin: the sensor in the solid's frame.
        direction: of the beam in the solid's frame.
        limit_m: range beyond which the answer does not matter.
    """
    density, clumped = leaves
    if clumped:
        density *= _CLUMP_PEAK
    t, end = max(chord.enter_m, 0.0), min(chord.leave_m, limit_m)
    for step in range(_MAX_STEPS):
        t -= np.log(unit(mix(chord.bits, 2 * step + 1))) / density
        if t >= end:
            return np.inf
        accept = unit(mix(chord.bits, 2 * step + 2)) * _CLUMP_PEAK
        if not clumped or accept < _clump(origin, direction, t):
            return float(t)
    return np.inf


@compiled(error_model="numpy")
def window_return(
    windows: tuple[float, float], chord: Chord, origin: Vector, direction: Vector, cosine: float
) -> tuple[float, float]:
    """(range, cosine) from a facade: from the wall, from inside a window, or lost in the glass.

    Args:
        windows: distance of the windows in metres, and their width over it.
        chord: the draw and where the beam meets the wall.
        origin: the sensor in the wall's frame.
        direction: of the beam in the wall's frame.
        cosine: of incidence on the wall.
    """
    pitch, share = windows
    enter = chord.enter_m
    along = (origin[0] + enter * direction[0] + origin[1] + enter * direction[1]) / pitch
    storey = (origin[2] + enter * direction[2]) / _STOREY_M
    across, up = along - np.floor(along), storey - np.floor(storey)
    if across > share or up < 0.3 or up > 0.8:
        return enter, cosine
    pane = mix(np.uint64(31), int(np.floor(along)) * 4096 + int(np.floor(storey)))
    curtain = 0.15 + 0.5 * unit(pane)
    u = unit(mix(chord.bits, 1))
    if u < curtain * cosine:
        return enter, cosine
    if u < 0.8:
        return enter, 0.0
    return enter - _INTERIOR_M * np.log(unit(mix(chord.bits, 2))), 0.5
