"""From what a beam met to what the sensor reports: power, losses, range noise, reflectance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.world.culling import Scan
from mottrack.world.hashing import bell, mix, unit
from mottrack.world.materials import Materials
from mottrack.world.raycast import GROUND, Returns
from mottrack.world.solids import Solids

_REFERENCE_ALBEDO = 0.8
_GROUND_ALBEDO = 0.16
_SLANT_NOISE = 0.004
_EDGE_M = 3.0


class Receiver(NamedTuple):
    """How well a sensor sees; named tuple for numba."""

    reach_m: float
    min_range_m: float
    range_noise_m: float
    drop_out: float
    edge_share: float
    """Share of beams at a depth edge that report a range in between."""


class Points(NamedTuple):
    """N reported points."""

    column: I64
    ring: I64
    range_m: F64
    reflectance: F32


@compiled(error_model="numpy")
def receive(
    scan: Scan, returns: Returns, surface: tuple[Solids, Materials], receiver: Receiver, seed: int
) -> Points:
    """Reports the beams that come back strongly enough, with noise; same seed, same points."""
    columns, rings = returns.range_m.shape
    limit = columns * rings
    points = Points(
        np.empty(limit, np.int64),
        np.empty(limit, np.int64),
        np.empty(limit, np.float64),
        np.empty(limit, np.float32),
    )
    solids, materials = surface
    count = 0
    for column in range(columns):
        for ring in range(rings):
            clear = returns.range_m[column, ring]
            cosine = returns.cosine[column, ring]
            if not np.isfinite(clear) or cosine <= 0.0:
                continue
            solid, material = returns.solid[column, ring], returns.material[column, ring]
            albedo = solids.albedo[solid] if solid >= 0 else _ground_albedo(material)
            lost = receiver.drop_out + materials.mirror[material] * (1.0 - cosine)
            shade = (albedo, materials.speckle[material], lost)
            key = mix(np.uint64(seed), 8 * (column * 4096 + ring))
            range_m, reflectance = _report(clear, cosine, shade, receiver, key)
            if range_m > 0.0 and unit(mix(key, 5)) < receiver.edge_share:
                range_m += _smear(returns.range_m, column, ring, unit(mix(key, 6)))
            if receiver.min_range_m <= range_m <= scan.max_range_m:
                points.column[count], points.ring[count] = column, ring
                points.range_m[count], points.reflectance[count] = range_m, reflectance
                count += 1
    return Points(
        points.column[:count],
        points.ring[:count],
        points.range_m[:count],
        points.reflectance[:count],
    )


@compiled(error_model="numpy")
def _report(
    range_m: float,
    cosine: float,
    shade: tuple[float, float, float],
    receiver: Receiver,
    key: np.uint64,
) -> tuple[float, float]:
    """(range, reflectance) of one beam; range 0 where nothing is reported."""
    albedo, speckle, lost = shade
    if unit(mix(key, 1)) < lost:
        return 0.0, 0.0
    spread = max(1.0 + speckle * bell(mix(key, 2)), 0.1)
    ratio = receiver.reach_m / range_m
    power = albedo * spread * cosine / _REFERENCE_ALBEDO * ratio * ratio
    if power < 6.0 and unit(mix(key, 3)) < np.exp(-1.1 * power):
        return 0.0, 0.0
    noise = receiver.range_noise_m + _SLANT_NOISE * (min(1.0 / cosine, 12.0) - 1.0)
    shine = albedo * spread * (0.35 + 0.65 * cosine)
    return range_m + noise * bell(mix(key, 4)), min(max(shine, 0.0), 1.0)


@compiled
def _ground_albedo(material: int) -> float:
    """Asphalt is dark; what stands out from it is brighter."""
    return _GROUND_ALBEDO + 0.05 * (material % 3)


@compiled
def _smear(range_m: F64, column: int, ring: int, share: float) -> float:
    """A beam split by an edge reports a range between the two surfaces, if they are close."""
    gap = range_m[min(column + 1, range_m.shape[0] - 1), ring] - range_m[column, ring]
    return share * gap if abs(gap) < _EDGE_M else 0.0


def is_ground(returns: Returns, points: Points) -> Mask:
    """(N,) whether each reported point lies on the ground."""
    return np.asarray(returns.solid[points.column, points.ring] == GROUND)
