"""From what a beam hit to what the sensor reports: power, losses, range noise, reflectance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64
from mottrack.world.culling import ScanPattern
from mottrack.world.hashing import near_normal, random_bits, uniform
from mottrack.world.raycast import Returns, SceneGeometry

_REFERENCE_ALBEDO = 0.8  # Data sheets of LiDARs state the range for a target of 80 % reflectivity
_GROUND_ALBEDO, _GROUND_STEP = 0.16, 0.05  # Asphalt is dark; what stands out from it is brighter
_DETECTION_RATE = 1.1  # 1 - exp(-1.1): a target at ``reach_m`` is seen two times out of three
_SURE_POWER = 6.0  # Above it fewer than 2 in 1000 are missed: no draw is made
_LEAST_SPECKLE = 0.1  # keeps the reflectance positive
_SLANT_NOISE_M, _MOST_SLANT = 0.004, 12.0
"""At a slant the footprint of the beam stretches over ranges; bounded at 85 degrees."""
_DULL, _SHINY = 0.35, 0.65
"""Weakening of the reported reflectance at a slant: firmware corrects for it in part. By eye."""
_EDGE_M = 3.0  # A beam split between surfaces further apart reports the first; chosen by eye
# numbers of the draws of one beam
_LOSS, _SPECKLE, _DETECTION, _NOISE, _SPLIT, _SPLIT_SHARE, _DRAWS = 1, 2, 3, 4, 5, 6, 8
_MOST_RINGS = 4096


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


class _Echo(NamedTuple):
    """Where a beam came back."""

    range_m: float
    cosine: float
    albedo: float
    speckle: float
    """Relative deviation of the reflectance."""
    loss: float
    """Probability that nothing comes back."""


@compiled(error_model="numpy")
def receive(
    scan: ScanPattern, returns: Returns, scene: SceneGeometry, receiver: Receiver, seed: int
) -> Points:
    """Report the beams that come back strongly enough, with noise; same seed, same points."""
    columns, rings = returns.range_m.shape
    limit = columns * rings
    points = Points(
        np.empty(limit, np.int64),
        np.empty(limit, np.int64),
        np.empty(limit, np.float64),
        np.empty(limit, np.float32),
    )
    albedo, materials = scene.solids.albedo, scene.materials
    count = 0
    for column in range(columns):
        for ring in range(rings):
            clear, cosine = returns.range_m[column, ring], returns.cosine[column, ring]
            if not np.isfinite(clear) or cosine <= 0.0:
                continue
            solid, material = returns.solid[column, ring], returns.material[column, ring]
            bright = albedo[solid] if solid >= 0 else _GROUND_ALBEDO + _GROUND_STEP * (material % 3)
            loss = receiver.drop_out + materials.mirror[material] * (1.0 - cosine)
            echo = _Echo(clear, cosine, bright, materials.speckle[material], loss)
            key = random_bits(np.uint64(seed), _DRAWS * (column * _MOST_RINGS + ring))
            range_m, reflectance = _report(echo, receiver, key)
            if range_m > 0.0 and uniform(random_bits(key, _SPLIT)) < receiver.edge_share:
                share = uniform(random_bits(key, _SPLIT_SHARE))
                range_m += _split(returns.range_m, column, ring, share)
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
def _report(echo: _Echo, receiver: Receiver, key: np.uint64) -> tuple[float, float]:
    """Return (range, reflectance) of one beam; range 0 where nothing is reported."""
    if uniform(random_bits(key, _LOSS)) < echo.loss:
        return 0.0, 0.0
    spread = max(1.0 + echo.speckle * near_normal(random_bits(key, _SPECKLE)), _LEAST_SPECKLE)
    ratio = receiver.reach_m / echo.range_m
    power = echo.albedo * spread * echo.cosine / _REFERENCE_ALBEDO * ratio * ratio
    draw = uniform(random_bits(key, _DETECTION))
    if power < _SURE_POWER and draw < np.exp(-_DETECTION_RATE * power):
        return 0.0, 0.0
    slant = min(1.0 / echo.cosine, _MOST_SLANT) - 1.0
    noise = receiver.range_noise_m + _SLANT_NOISE_M * slant
    shine = echo.albedo * spread * (_DULL + _SHINY * echo.cosine)
    range_m = echo.range_m + noise * near_normal(random_bits(key, _NOISE))
    return range_m, min(max(shine, 0.0), 1.0)


@compiled
def _split(range_m: F64, column: int, ring: int, share: float) -> float:
    """Return by how much a beam split by an edge reports more than its first surface."""
    gap = range_m[min(column + 1, range_m.shape[0] - 1), ring] - range_m[column, ring]
    return share * gap if abs(gap) < _EDGE_M else 0.0
