"""The measurement grid: Dempster-Shafer masses of one sweep on the world-aligned window."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I32, U8, Mask
from mottrack.core.sweep import Sweep
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Span, Workers
from mottrack.flow.sweep_pair import GroundStage
from mottrack.lidar.ground import find_ground

GROUND, OBSTACLE, OVERHEAD, OWN = (np.uint8(kind) for kind in range(4))
"""What reflected a point. Overhead points only show that their direction is in view; points of the
own vehicle are no evidence at all."""
_MAX_SIXTHS = 60
"""Ten returns of a cell leave next to nothing unknown."""


class SensorConfig(StrictModel):
    """The inverse sensor model; distances in metres from the sensor's optical centre."""

    azimuth_bins: int = Field(720, ge=8, le=7200, description="directions of the polar view")
    occupied_mass: float = Field(0.9, gt=0, lt=1, description="evidence of a single return")
    range_noise_m: float = Field(0.05, ge=0, description="standard deviation of a return's range")
    free_mass_near: float = Field(0.95, ge=0, lt=1, description="evidence of free space at 0 m")
    free_mass_far: float = Field(
        0.4, ge=0, lt=1, description="... at `max_range_m`, linear between"
    )
    max_range_m: float = Field(70.0, gt=0, description="nothing is known to be free farther away")
    no_return_free_m: float = Field(
        0.0, ge=0, description="free reach of a direction in view without any return"
    )
    widest_gap_rad: float = Field(
        0.2, gt=0, description="a gap without returns wider than this is outside the field of view"
    )


class Returns(NamedTuple):
    """N points of a sweep on the plane, around the sensor's optical centre."""

    xy_m: F32
    """(N, 2) along the world's axes, from the optical centre."""
    kind: U8
    """(N,) GROUND, OBSTACLE, OVERHEAD or OWN."""
    centre_m: F64
    """(2,) the optical centre in the world."""


class Masses(NamedTuple):
    """Dempster-Shafer masses of the hypotheses occupied and free; the rest is unknown."""

    occupied: F32
    """(rows, cols)."""
    free: F32
    """(rows, cols)."""

    @classmethod
    def unknown(cls, shape: tuple[int, int]) -> Masses:
        """Return masses of zero: nothing is known of any cell."""
        return cls(np.zeros(shape, np.float32), np.zeros(shape, np.float32))


class _Beams(NamedTuple):
    """The sweep and the sensor, as the kernel takes them."""

    reach_m: F32
    """(A,) free reach of each azimuth bin."""
    centre_m: F32
    """(2,) the optical centre, from the window's corner."""
    unknown: F32
    """(K,) mass that k sixths of returns leave unknown; more than K - 1 leave as little."""
    near: float
    """Free mass at no distance."""
    far: float
    """Free mass at the greatest range."""
    max_range_m: float


def returns_of(sweep: Sweep, stage: GroundStage) -> Returns:
    """Classify the points: between the stage's two heights obstacles, ground below."""
    pose = sweep.world_T_ego
    x_m, y_m, z_m = (sweep.xyz_m - sweep.origin_m.astype(np.float32)).T
    xy_m = np.empty((len(sweep), 2), np.float32)
    for axis in range(2):
        # by column: a product with so thin a matrix would start the threads of BLAS
        to_x, to_y, to_z = pose.rotation[axis].astype(np.float32)
        xy_m[:, axis] = x_m * to_x + y_m * to_y + z_m * to_z
    return Returns(xy_m, _kinds(sweep.xyz_m, stage), pose.apply(sweep.origin_m[None])[0, :2])


def _kinds(xyz_m: F32, stage: GroundStage) -> U8:
    """Return (N,) what reflected each point (N, 3) of the ego frame."""
    kind = np.full(len(xyz_m), OBSTACLE)
    if len(xyz_m) and stage.enabled:
        height_m = find_ground(xyz_m, stage.find).height_m
        kind[height_m >= stage.max_height_m] = OVERHEAD
        kind[height_m <= stage.min_height_m] = GROUND
    kind[xyz_m[:, 0] ** 2 + xyz_m[:, 1] ** 2 <= stage.min_range_m**2] = OWN
    return kind


def measure(returns: Returns, window: Window, config: SensorConfig, workers: Workers) -> Masses:
    """Return masses occupied where returns end, free in front of the first of each direction.

    Returns are fused by Dempster's rule: n of them leave (1 - p)^n of a cell's mass unknown. Free
    mass takes its share of what the returns left, so the masses never exceed one.
    """
    beams = _Beams(
        free_reach_m(returns, config),
        (returns.centre_m - window.corner_m).astype(np.float32),
        ((1 - config.occupied_mass) ** (np.arange(_MAX_SIXTHS + 1) / 6)).astype(np.float32),
        config.free_mass_near,
        config.free_mass_far,
        config.max_range_m,
    )
    hits = np.zeros(window.shape, np.int32)
    # the outer nodes of the quadrature lie sqrt(3) standard deviations from the middle one
    spread_m = np.float32(config.range_noise_m * np.sqrt(3))
    _count_hits(returns, window, beams.centre_m, spread_m, hits)
    measured = Masses.unknown(window.shape)
    workers.run(_masses, window.rows, beams, window, hits, measured)
    return measured


def free_reach_m(returns: Returns, config: SensorConfig) -> F32:
    """Return (A,) how far each azimuth bin is seen free; bin 0 begins at -pi.

    The first obstacle of a direction ends its free reach, else the farthest ground point. Where a
    direction inside the field of view has neither, it is free up to `no_return_free_m`.
    """
    bins = config.azimuth_bins
    first_m, ground_m, hit = _extremes(returns.xy_m, returns.kind, bins)
    in_view = ~_wide_gaps(hit, round(config.widest_gap_rad / (2 * np.pi) * bins))
    open_m = np.maximum(ground_m, np.where(in_view, np.float32(config.no_return_free_m), 0))
    return np.where(np.isinf(first_m), open_m, first_m).astype(np.float32)


def _wide_gaps(hit: Mask, widest: int) -> Mask:
    """Return (A,) bins in circular runs of more than `widest` bins without a return."""
    bins = len(hit)
    if not hit.any():
        return np.ones(bins, np.bool_)
    seen = np.flatnonzero(hit)
    following = np.append(seen[1:], seen[0] + bins)
    wide = np.zeros(bins, np.bool_)
    for begin, end in zip(seen, following, strict=True):
        if end - begin - 1 > widest:
            wide[np.arange(begin + 1, end) % bins] = True
    return wide


class _Extremes(NamedTuple):
    first_m: F32
    """(A,) range of the nearest obstacle, infinite where none."""
    ground_m: F32
    """(A,) range of the farthest ground point, 0 where none."""
    hit: Mask
    """(A,) whether there is any return."""


@compiled(nogil=True)
def _extremes(xy_m: F32, kind: U8, bins: int) -> _Extremes:
    first_m = np.full(bins, np.inf, np.float32)
    ground_m = np.zeros(bins, np.float32)
    hit = np.zeros(bins, np.bool_)
    per_rad = np.float32(bins / (2 * np.pi))
    for i in range(len(xy_m)):
        if kind[i] == OWN:
            continue
        x_m, y_m = xy_m[i, 0], xy_m[i, 1]
        b = min(int((np.arctan2(y_m, x_m) + np.float32(np.pi)) * per_rad), bins - 1)
        range_m = np.sqrt(x_m * x_m + y_m * y_m)
        hit[b] = True
        if kind[i] == OBSTACLE:
            first_m[b] = min(first_m[b], range_m)
        elif kind[i] == GROUND:
            ground_m[b] = max(ground_m[b], range_m)
    return _Extremes(first_m, ground_m, hit)


@compiled(nogil=True)
def _count_hits(
    returns: Returns, window: Window, centre_m: F32, spread_m: np.float32, hits: I32
) -> None:
    """Count sixths of returns per cell: range errors by Gauss-Hermite quadrature, 1:4:1."""
    per_m = np.float32(1.0 / window.cell_m)
    for i in range(len(returns.kind)):
        if returns.kind[i] != OBSTACLE:
            continue
        x_m, y_m = returns.xy_m[i, 0], returns.xy_m[i, 1]
        step = spread_m / max(np.sqrt(x_m * x_m + y_m * y_m), spread_m)
        for side in range(-1, 2):
            stretch = np.float32(1) + side * step
            col = int(np.floor((centre_m[0] + x_m * stretch) * per_m))
            row = int(np.floor((centre_m[1] + y_m * stretch) * per_m))
            if 0 <= row < window.rows and 0 <= col < window.cols:
                hits[row, col] += 4 if side == 0 else 1


@compiled(nogil=True)
def _masses(rows: Span, beams: _Beams, window: Window, hits: I32, measured: Masses) -> None:
    most = len(beams.unknown) - 1
    for row in range(rows[0], rows[1]):
        y_m = (row + 0.5) * window.cell_m - beams.centre_m[1]
        for col in range(window.cols):
            x_m = (col + 0.5) * window.cell_m - beams.centre_m[0]
            unknown = beams.unknown[min(hits[row, col], most)]
            measured.occupied[row, col] = 1 - unknown
            range_m = np.sqrt(x_m * x_m + y_m * y_m)
            in_range = range_m < beams.max_range_m
            if in_range and _seen_free(x_m, y_m, window.cell_m, beams.reach_m):
                fall = (beams.far - beams.near) * range_m / beams.max_range_m
                measured.free[row, col] = unknown * (beams.near + fall)


@compiled(nogil=True)
def _seen_free(x_m: float, y_m: float, cell_m: float, reach_m: F32) -> bool:
    """Return whether every direction that crosses the cell is free to the cell's far side."""
    bins = len(reach_m)
    per_rad = np.float32(bins / (2 * np.pi))
    half_m = np.float32(0.5 * cell_m)
    range_m = np.float32(np.sqrt(x_m * x_m + y_m * y_m))
    middle = (np.arctan2(np.float32(y_m), np.float32(x_m)) + np.float32(np.pi)) * per_rad
    half = min(half_m / max(range_m, half_m) * per_rad, np.float32(0.5 * bins))
    first = int(np.floor(middle - half))
    b = first + bins if first < 0 else first
    for _ in range(int(np.floor(middle + half)) - first + 1):
        b = b - bins if b >= bins else b
        if reach_m[b] < range_m + half_m:
            return False
        b += 1
    return True
