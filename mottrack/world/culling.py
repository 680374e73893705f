"""Culling: which solids the beams of which column of a scan can hit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.world.solids import BOX, Solids, solid_pose_at

_REVOLUTION = 2.0 * np.pi
_ALL_AROUND = 1e9  # Azimuth that stands for a solid around the sensor: larger than any angle
_SPANS = 4
_FIXED_POINT_STEPS = 4
"""A solid moves by few columns within a scan: two or three steps find its column."""
# allowances, each far above the error that it covers and small against a solid's own span
_ASIDE_M = 0.1  # around a box, within which the sensor counts as inside
_DRIFT_MPS = 1.0  # speed, for what acceleration and yaw rate add within a scan
_STRETCH = 1.05  # of a span
_TILT_STRETCH, _TILT_RAD = 1.1, 0.002  # of the sensor's tilt, which changes within a scan
_MARGIN_RAD = 0.006  # one to two columns
_CLEAR_SHARE = 20  # a 20th of a revolution from the seam there is no second span


class ScanPattern(NamedTuple):
    """How the sensor moves and fires in one revolution: C columns of R beams."""

    time_s: F64
    """(C,) firing time of each column relative to the stamp."""
    origin_m: F64
    """(C, 3) optical centre in the world."""
    rotation: F64
    """(C, 3, 3) world_R_sensor."""
    azimuth_rad: F64
    """(C,) azimuth in the sensor frame, monotonous over one revolution."""
    elevation_rad: F64
    """(R,) elevation of each beam."""
    offset_rad: F64
    """(R,) azimuth of each beam relative to its column."""
    max_range_m: float


class Candidates(NamedTuple):
    """``solid[start[c]:start[c + 1]]`` can be hit in column c, nearest first."""

    start: I64
    solid: I64


class _Search(NamedTuple):
    """Where the azimuth of a solid is looked for."""

    column: int
    """First guess of the column."""
    revolutions: int
    """Added to the azimuth."""
    margin_rad: float


class _Interval(NamedTuple):
    """Azimuths in the sensor frame."""

    low: float
    high: float


@compiled
def find_candidates(scan: ScanPattern, solids: Solids) -> Candidates:
    """Sort the solids into the columns in which they can be hit."""
    near_m = _near_bounds(scan, solids)
    order = np.argsort(near_m)
    order = order[: np.searchsorted(near_m[order], scan.max_range_m)]
    spans = np.empty((len(order), _SPANS, 2), np.int64)
    count, margin = np.zeros(len(scan.time_s) + 1, np.int64), _margin(scan)
    for i in range(len(order)):
        _column_spans(scan, solids, order[i], margin, spans[i])
        for k in range(_SPANS):
            for c in range(spans[i, k, 0], spans[i, k, 1]):
                count[c + 1] += 1
    start = np.cumsum(count)
    place = start[:-1].copy()
    solid = np.empty(start[-1], np.int64)
    for i in range(len(order)):
        for k in range(_SPANS):
            for c in range(spans[i, k, 0], spans[i, k, 1]):
                solid[place[c]] = order[i]
                place[c] += 1
    return Candidates(start, solid)


@compiled
def _near_bounds(scan: ScanPattern, solids: Solids) -> F64:
    """Return (P,) a lower bound on the distance of every solid during the whole scan."""
    middle = scan.origin_m[len(scan.origin_m) // 2]
    ends = scan.origin_m[-1] - scan.origin_m[0]
    travel = np.sqrt(ends[0] ** 2 + ends[1] ** 2)
    period = max(abs(scan.time_s[0]), abs(scan.time_s[-1]))
    near = np.empty(len(solids.kind))
    for p in range(len(near)):
        d = np.hypot(solids.centre_m[p, 0] - middle[0], solids.centre_m[p, 1] - middle[1])
        speed = np.hypot(solids.velocity_mps[p, 0], solids.velocity_mps[p, 1])
        radius = np.hypot(solids.half_m[p, 0], solids.half_m[p, 1])
        moved = (speed + _DRIFT_MPS) * period if speed > 0.0 else 0.0
        near[p] = d - radius - travel - moved
    return near


@compiled
def _column_spans(scan: ScanPattern, solids: Solids, p: int, margin: float, spans: I64) -> None:
    """Fill up to four ranges of columns: a moving solid at the seam is hit twice, or never.

    Its azimuth is looked for from the first column and from the last, and one revolution before
    and after, since it may reach over either end of the scan.
    """
    last = len(scan.time_s) - 1
    spans[:] = 0
    if _one_span(scan, solids, p, _Search(0, 0, margin), spans[0]):
        return
    _one_span(scan, solids, p, _Search(0, -1, margin), spans[1])
    _one_span(scan, solids, p, _Search(last, 0, margin), spans[2])
    _one_span(scan, solids, p, _Search(last, 1, margin), spans[3])
    if spans[2, 0] < spans[0, 1] and spans[0, 0] < spans[2, 1]:
        spans[0, 0], spans[0, 1] = min(spans[0, 0], spans[2, 0]), max(spans[0, 1], spans[2, 1])
        spans[2] = 0


@compiled
def _one_span(scan: ScanPattern, solids: Solids, p: int, search: _Search, span: I64) -> bool:
    """Fill the range of columns around the column in which the beam meets the moving solid.

    Returns:
        Whether that range is well clear of the seam, so that there is no other.
    """
    column, columns = search.column, len(scan.time_s)
    step = (scan.azimuth_rad[-1] - scan.azimuth_rad[0]) / max(columns - 1, 1)
    sense = np.sign(step)
    shift = width = 0.0
    for _ in range(_FIXED_POINT_STEPS):
        before = column
        seen = _azimuths_at(scan, solids, p, column)
        if seen.high >= _ALL_AROUND:
            span[0], span[1] = 0, columns if search.revolutions == 0 else 0
            return search.revolutions == 0
        width = 0.5 * (seen.high - seen.low)
        shift = (0.5 * (seen.low + seen.high) - scan.azimuth_rad[0]) % _REVOLUTION
        if step <= 0.0:
            shift -= _REVOLUTION
        shift += sense * search.revolutions * _REVOLUTION
        column = min(max(int(shift / step), 0), columns - 1)
        if abs(column - before) < 2:
            break
    reach = width * _stretch(scan, solids, p) + search.margin_rad
    first = int(np.floor((shift - sense * reach) / step))
    last = int(np.ceil((shift + sense * reach) / step)) + 1
    span[0], span[1] = min(max(first, 0), columns), min(max(last, 0), columns)
    spare = columns // _CLEAR_SHARE
    return spare < first and last < columns - spare


@compiled
def _stretch(scan: ScanPattern, solids: Solids, p: int) -> float:
    """Return the factor by which a span widens as things move while the beam passes over them."""
    ends = scan.origin_m[-1] - scan.origin_m[0]
    period = abs(scan.time_s[-1] - scan.time_s[0])
    vx, vy = solids.velocity_mps[p, 0], solids.velocity_mps[p, 1]
    travel = np.hypot(ends[0], ends[1]) + period * np.hypot(vx, vy)
    dx = solids.centre_m[p, 0] - scan.origin_m[0, 0]
    dy = solids.centre_m[p, 1] - scan.origin_m[0, 1]
    return float(_STRETCH + 0.5 * travel / max(np.hypot(dx, dy) - travel, 1.0))


@compiled
def _margin(scan: ScanPattern) -> float:
    """Return the angle by which beams of tilted or staggered rings may leave their column."""
    up = scan.rotation[0, 2, 2]
    tilt = np.sqrt(max(1.0 - up * up, 0.0)) * _TILT_STRETCH + _TILT_RAD
    steepest = np.tan(np.max(np.abs(scan.elevation_rad)))
    return float(tilt * steepest + np.max(np.abs(scan.offset_rad)) + _MARGIN_RAD)


@compiled
def _azimuths_at(scan: ScanPattern, solids: Solids, p: int, column: int) -> _Interval:
    """Return the azimuths between which a solid lies when column ``column`` fires."""
    x, y, _, yaw = solid_pose_at(solids, p, scan.time_s[column])
    dx, dy = x - scan.origin_m[column, 0], y - scan.origin_m[column, 1]
    rotation = scan.rotation[column]
    heading = np.arctan2(rotation[1, 0], rotation[0, 0])
    half_x, half_y = solids.half_m[p, 0], solids.half_m[p, 1]
    c, s = np.cos(yaw), np.sin(yaw)
    along, across = abs(c * dx + s * dy), abs(c * dy - s * dx)
    if along < half_x + _ASIDE_M and across < half_y + _ASIDE_M:
        return _Interval(-_ALL_AROUND, _ALL_AROUND)
    centre = np.arctan2(dy, dx)
    if solids.kind[p] != BOX:
        distance, radius = np.hypot(dx, dy), max(half_x, half_y)
        wide = np.arcsin(radius / distance) if distance > radius else 0.5 * np.pi
        return _Interval(centre - heading - wide, centre - heading + wide)
    low = high = 0.0
    for corner in range(4):
        u = half_x if corner % 2 == 0 else -half_x
        v = half_y if corner < 2 else -half_y
        px, py = dx + c * u - s * v, dy + s * u + c * v
        aside = np.arctan2(dx * py - dy * px, dx * px + dy * py)
        low, high = min(low, aside), max(high, aside)
    return _Interval(centre - heading + low, centre - heading + high)
