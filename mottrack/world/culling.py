"""Which solids can be met by the beams of which column of a scan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.world.solids import BOX, Solids

_TURN = 2.0 * np.pi
_WHOLE = 1e9
_SPANS = 4
_FIXED_POINT_STEPS = 4


class Scan(NamedTuple):
    """How the sensor moves and fires in one turn: C columns of R beams; named tuple for numba."""

    time_s: F64
    """(C,) firing time of each column relative to the stamp."""
    origin_m: F64
    """(C, 3) optical centre in the world."""
    rotation: F64
    """(C, 3, 3) world_R_sensor."""
    azimuth_rad: F64
    """(C,) azimuth in the sensor frame, monotonous over one turn."""
    elevation_rad: F64
    """(R,) elevation of each beam."""
    offset_rad: F64
    """(R,) azimuth of each beam relative to its column."""
    max_range_m: float


class Candidates(NamedTuple):
    """``solid[start[c]:start[c + 1]]`` can be met in column c, nearest first."""

    start: I64
    solid: I64
    near_m: F64
    """(P,) lower bound on the distance of every solid during the whole scan."""


@compiled
def find_candidates(scan: Scan, solids: Solids) -> Candidates:
    """Sorts the solids into the columns from which they can be met."""
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
    return Candidates(start, solid, near_m)


@compiled
def _near_bounds(scan: Scan, solids: Solids) -> F64:
    middle = scan.origin_m[len(scan.origin_m) // 2]
    ends = scan.origin_m[-1] - scan.origin_m[0]
    travel = np.sqrt(ends[0] ** 2 + ends[1] ** 2)
    period = max(abs(scan.time_s[0]), abs(scan.time_s[-1]))
    near = np.empty(len(solids.kind))
    for p in range(len(near)):
        d = np.hypot(solids.centre_m[p, 0] - middle[0], solids.centre_m[p, 1] - middle[1])
        speed = np.hypot(solids.velocity_mps[p, 0], solids.velocity_mps[p, 1]) + 1.0
        moving = speed > 1.0
        radius = np.hypot(solids.half_m[p, 0], solids.half_m[p, 1])
        near[p] = d - radius - travel - (speed * period if moving else 0.0)
    return near


@compiled
def solid_pose_at(solids: Solids, p: int, tau_s: float) -> tuple[float, float, float, float]:
    """(x, y, z, yaw) of a solid at a time relative to the stamp."""
    half = 0.5 * tau_s * tau_s
    centre, velocity, acceleration = solids.centre_m, solids.velocity_mps, solids.acceleration_mps2
    return (
        centre[p, 0] + tau_s * velocity[p, 0] + half * acceleration[p, 0],
        centre[p, 1] + tau_s * velocity[p, 1] + half * acceleration[p, 1],
        centre[p, 2] + tau_s * velocity[p, 2] + half * acceleration[p, 2],
        solids.yaw_rad[p] + tau_s * solids.yaw_rate_radps[p],
    )


@compiled
def _column_spans(scan: Scan, solids: Solids, p: int, margin: float, spans: I64) -> None:
    """Fills up to four column ranges: a moving thing at the seam is met twice, or never.

    Its azimuth is looked for from the first column and from the last, and one turn before and
    after, since it may stick out over either end of the scan.
    """
    columns = len(scan.time_s)
    spans[:] = 0
    clear = _one_span(scan, solids, p, (0, 0, margin), spans[0])
    if clear:
        return
    _one_span(scan, solids, p, (0, -1, margin), spans[1])
    _one_span(scan, solids, p, (columns - 1, 0, margin), spans[2])
    _one_span(scan, solids, p, (columns - 1, 1, margin), spans[3])
    if spans[2, 0] < spans[0, 1] and spans[0, 0] < spans[2, 1]:
        spans[0, 0], spans[0, 1] = min(spans[0, 0], spans[2, 0]), max(spans[0, 1], spans[2, 1])
        spans[2, 0] = spans[2, 1] = 0


@compiled
def _one_span(
    scan: Scan,
    solids: Solids,
    p: int,
    guess: tuple[int, int, float],
    span: I64,
) -> bool:
    """Fills the range of columns around the column at which the beam meets the moving solid.

    Returns whether that range is well clear of the seam, so that there is no other.
    """
    column, turns, margin = guess
    columns = len(scan.time_s)
    step = (scan.azimuth_rad[-1] - scan.azimuth_rad[0]) / max(columns - 1, 1)
    way = np.sign(step)
    shift = width = 0.0
    for _ in range(_FIXED_POINT_STEPS):
        before = column
        low, high = _span_at(scan, solids, p, column)
        if high >= _WHOLE:
            span[0], span[1] = 0, columns if turns == 0 else 0
            return turns == 0
        width = 0.5 * (high - low)
        shift = _wrapped(0.5 * (low + high) - scan.azimuth_rad[0], step) + way * turns * _TURN
        column = min(max(int(shift / step), 0), columns - 1)
        if abs(column - before) < 2:
            break
    reach = width * _stretch(scan, solids, p) + margin
    first = int(np.floor((shift - way * reach) / step))
    last = int(np.ceil((shift + way * reach) / step)) + 1
    span[0], span[1] = min(max(first, 0), columns), min(max(last, 0), columns)
    spare = columns // 20
    return spare < first and last < columns - spare


@compiled
def _wrapped(angle: float, step: float) -> float:
    """The angle as a way to go in the scan's direction, within one turn."""
    turned = angle % _TURN
    return turned if step > 0.0 else turned - _TURN


@compiled
def _stretch(scan: Scan, solids: Solids, p: int) -> float:
    """Factor by which a span widens because things move while the beam passes over them."""
    ends = scan.origin_m[-1] - scan.origin_m[0]
    period = abs(scan.time_s[-1] - scan.time_s[0])
    vx, vy = solids.velocity_mps[p, 0], solids.velocity_mps[p, 1]
    travel = np.hypot(ends[0], ends[1]) + period * np.hypot(vx, vy)
    dx = solids.centre_m[p, 0] - scan.origin_m[0, 0]
    dy = solids.centre_m[p, 1] - scan.origin_m[0, 1]
    return float(1.05 + 0.5 * travel / max(np.hypot(dx, dy) - travel, 1.0))


@compiled
def _margin(scan: Scan) -> float:
    """Angle by which beams of tilted or staggered rings may leave their column."""
    up = scan.rotation[0, 2, 2]
    tilt = np.sqrt(max(1.0 - up * up, 0.0)) * 1.1 + 0.002
    steepest = np.tan(np.max(np.abs(scan.elevation_rad)))
    return float(tilt * steepest + np.max(np.abs(scan.offset_rad)) + 0.006)


@compiled
def _span_at(scan: Scan, solids: Solids, p: int, column: int) -> tuple[float, float]:
    """Sensor azimuths between which a solid lies when column ``column`` fires."""
    x, y, _, yaw = solid_pose_at(solids, p, scan.time_s[column])
    dx, dy = x - scan.origin_m[column, 0], y - scan.origin_m[column, 1]
    rotation = scan.rotation[column]
    heading = np.arctan2(rotation[1, 0], rotation[0, 0])
    half_x, half_y = solids.half_m[p, 0], solids.half_m[p, 1]
    distance = np.hypot(dx, dy)
    c, s = np.cos(yaw), np.sin(yaw)
    along, across = abs(c * dx + s * dy), abs(c * dy - s * dx)
    if along < half_x + 0.1 and across < half_y + 0.1:
        return -_WHOLE, _WHOLE
    centre = np.arctan2(dy, dx)
    if solids.kind[p] != BOX:
        radius = max(half_x, half_y)
        wide = np.arcsin(radius / distance) if distance > radius else 0.5 * np.pi
        return centre - heading - wide, centre - heading + wide
    low = high = 0.0
    for corner in range(4):
        u = half_x if corner % 2 == 0 else -half_x
        v = half_y if corner < 2 else -half_y
        px, py = dx + c * u - s * v, dy + s * u + c * v
        turn = np.arctan2(dx * py - dy * px, dx * px + dy * py)
        low, high = min(low, turn), max(high, turn)
    return centre - heading + low, centre - heading + high
