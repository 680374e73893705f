"""Splits and merges of clusters, so that a track survives both.

A split: an occlusion cuts an object; its pieces lie inside the hull that the track predicts. As
long as their common hull is no larger than that, they are one measurement. Pieces that leave the
hull become tracks of their own and take over the velocity.

A merge: two neighbours are close enough to be one component. Its centre belongs to neither, so it
is no measurement; the tracks coast until the components separate, or until `max_coast_s` is over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.core.motion import VelocityMeasurement, concatenate_velocities
from mottrack.core.objects import Objects
from mottrack.geometry.hulls import hulls_of_groups
from mottrack.geometry.polygon import clip_area, polygon_area
from mottrack.trackers.association import candidate_pairs
from mottrack.trackers.fixed_lag.config import MergeSplitConfig

SMALLEST_AREA_M2 = 1e-6
"""Lower bound of a hull's area: shares of it must not divide by zero."""
SMALLEST_SIDE_M = 0.1
"""Lower bound of a joined object's length and width; below, a box is not visible to a LiDAR."""
DUPLICATE_AREA_RATIO = 1.2
"""Tracks whose areas sum to more than this times the object's lie on top of each other."""


class HullList(NamedTuple):
    """Convex, counter-clockwise hulls of N objects or tracks, one after the other."""

    corner_m: F64
    """(sum K, 2)."""
    start: I64
    """(N + 1,) first corner of each."""

    def polygons(self) -> tuple[F64, ...]:
        """Return the corners (K, 2) of each."""
        return tuple(self.corner_m[a:b] for a, b in pairwise(self.start.tolist()))


def flat(hulls: Sequence[F64]) -> HullList:
    """Return hulls (K, 2) in one list."""
    start = np.zeros(len(hulls) + 1, np.int64)
    np.cumsum([len(hull) for hull in hulls], out=start[1:])
    return HullList(np.concatenate(hulls) if hulls else np.zeros((0, 2)), start)


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Overlapping pairs of predicted hulls of tracks (N) and hulls of objects (M)."""

    track: I64
    """(P,) row of the track of each overlapping pair."""
    object: I64
    """(P,) row of the object."""
    area_m2: F64
    """(P,) shared area."""
    track_area_m2: F64
    """(N,)."""
    object_area_m2: F64
    """(M,)."""

    @property
    def of_track(self) -> F64:
        """(P,) share of the track's hull that the object covers."""
        return self.area_m2 / self.track_area_m2[self.track]

    @property
    def of_object(self) -> F64:
        """(P,) share of the object's hull that lies in the track's."""
        return self.area_m2 / self.object_area_m2[self.object]

    @property
    def iou(self) -> F64:
        """(P,) intersection over union."""
        union = self.track_area_m2[self.track] + self.object_area_m2[self.object] - self.area_m2
        return self.area_m2 / union


def no_overlaps(tracks: int, objects: int) -> Overlaps:
    """Return no pairs, as for boxes, which do not split or merge."""
    none = np.zeros(0, np.int64)
    return Overlaps(none, none, np.zeros(0), np.ones(tracks), np.ones(objects))


def overlaps(tracks: HullList, objects: HullList) -> Overlaps:
    """Return all overlapping pairs of two sets of hulls in one frame."""
    one, other = _extents(tracks), _extents(objects)
    reach_m = other.half_m + one.half_m.max(axis=0, initial=0.0)
    track, found = candidate_pairs(one.middle_m, other.middle_m, reach_m)
    apart_m = np.abs(one.middle_m[track] - other.middle_m[found])
    touch = (apart_m <= one.half_m[track] + other.half_m[found]).all(axis=1)
    track, found = track[touch], found[touch]
    area = _shared_area(tracks, objects, (track, found))
    kept = area > 0.0
    return Overlaps(track[kept], found[kept], area[kept], one.area_m2, other.area_m2)


class _Extents(NamedTuple):
    """Bounds and areas of N hulls."""

    middle_m: F64
    """(N, 2) of the bounds along x and y."""
    half_m: F64
    """(N, 2) half the distance between the bounds."""
    area_m2: F64
    """(N,) at least `SMALLEST_AREA_M2`."""


def _extents(hulls: HullList) -> _Extents:
    corner, first = hulls.corner_m, hulls.start[:-1]
    low, high = np.minimum.reduceat(corner, first), np.maximum.reduceat(corner, first)
    # shoelace formula about each hull's first corner, so that map coordinates cost no precision
    following = np.arange(1, len(corner) + 1)
    following[hulls.start[1:] - 1] = first
    x, y = (corner - np.repeat(corner[first], np.diff(hulls.start), axis=0)).T
    twice = np.add.reduceat(x * y[following] - y * x[following], first)
    return _Extents(
        0.5 * (low + high), 0.5 * (high - low), np.maximum(0.5 * np.abs(twice), SMALLEST_AREA_M2)
    )


@compiled
def _shared_area(one: HullList, other: HullList, pairs: tuple[I64, I64]) -> F64:
    """Return the area (P,) shared by the hulls of each pair.

    Compiled: 300 tracks and objects take 0.5 ms, with shapely 13 ms
    (`benchmarks/polygons.py`).
    """
    area = np.zeros(len(pairs[0]))
    for p in range(len(area)):
        i, j = pairs[0][p], pairs[1][p]
        origin = one.corner_m[one.start[i]].copy()
        a = one.corner_m[one.start[i] : one.start[i + 1]] - origin
        b = other.corner_m[other.start[j] : other.start[j + 1]] - origin
        area[p] = clip_area(a, b, np.empty((2, len(a) + len(b) + 1, 2)))
    return area


class Group(NamedTuple):
    """A track (row) and the objects (rows) that are its pieces, or an object and its tracks."""

    owner: int
    members: I64


def fragments(pairs: Overlaps, config: MergeSplitConfig) -> list[Group]:
    """Return tracks whose predicted hull holds several objects that fit no other track better."""
    if len(pairs.track) == 0:
        return []
    order = np.lexsort((-pairs.iou, pairs.object))
    _, first = np.unique(pairs.object[order], return_index=True)
    best = order[first]
    small = pairs.object_area_m2[pairs.object[best]] < pairs.track_area_m2[pairs.track[best]]
    inside = best[(pairs.of_object[best] >= config.min_overlap) & small]
    return _groups(pairs.track[inside], pairs.object[inside])


def _groups(owner: I64, member: I64) -> list[Group]:
    """Return owners with at least two members."""
    order = np.argsort(owner, kind="stable")
    owners, first, count = np.unique(owner[order], return_index=True, return_counts=True)
    members = np.split(member[order], first[1:])
    return [Group(int(owners[k]), members[k]) for k in np.flatnonzero(count > 1).tolist()]


def joined(objects: Objects, groups: list[Group], track_area_m2: F64, max_growth: float) -> Objects:
    """Return the objects with the pieces of each track replaced by one, where that is no larger."""
    gone: list[int] = []
    rows: list[Objects] = []
    for track, group in groups:
        one = _joined(objects, group)
        limit_m2 = max_growth * track_area_m2[track]
        if one.hull is not None and polygon_area(one.hull[0]) <= limit_m2:
            gone.extend(group.tolist())
            rows.append(one)
    if not rows:
        return objects
    kept = objects.select(~np.isin(np.arange(len(objects)), gone))
    return _stacked([kept, *rows])


def _joined(objects: Objects, group: I64) -> Objects:
    """Return one object with the common hull of a group; other fields are its largest piece's."""
    hulls = objects.hull or ()
    size = np.array([polygon_area(hulls[k]) for k in group])
    largest = objects.select(group[[int(size.argmax())]])
    corners = np.concatenate([hulls[k] for k in group])
    origin = corners[0].copy()
    hull = hulls_of_groups(corners - origin, np.array([0, len(corners)]))
    low = (objects.centre_m[group, 2] - objects.size_m[group, 2] / 2).min()
    high = (objects.centre_m[group, 2] + objects.size_m[group, 2] / 2).max()
    share = size / size.sum()
    centre_m = np.append(share @ objects.centre_m[group, :2], 0.5 * (low + high))
    size_m = np.append(np.maximum(hull.rectangle[0, 2:4], SMALLEST_SIDE_M), high - low)
    velocity = objects.velocity
    return replace(
        largest,
        centre_m=centre_m[None],
        size_m=size_m[None],
        yaw_rad=hull.rectangle[:, 4],
        hull=(hull.corner_m + origin,),
        velocity=None if velocity is None else _mean_velocity(velocity, group, size),
        num_points=None if objects.num_points is None else objects.num_points[group].sum()[None],
    )


def _mean_velocity(velocity: VelocityMeasurement, group: I64, size: F64) -> VelocityMeasurement:
    weight = np.where(velocity.valid[group], size, 0.0)
    if weight.sum() == 0:
        return VelocityMeasurement.absent(1)
    share = weight / weight.sum()
    mean = share @ velocity.mean_mps[group]
    covariance = np.einsum("n,nij->ij", share, velocity.covariance_m2ps2[group])
    return VelocityMeasurement(mean[None], covariance[None], np.array([True]))


def _stacked(parts: list[Objects]) -> Objects:
    """Return all rows of several sets of objects that have the same fields."""
    optional = ("position_covariance_m2", "num_points")
    names = ["centre_m", "size_m", "yaw_rad", "label", "score"]
    names += [name for name in optional if getattr(parts[0], name) is not None]
    changes: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in names
    }
    changes["hull"] = tuple(hull for part in parts for hull in part.hull or ())
    velocities = [part.velocity for part in parts if part.velocity is not None]
    changes["velocity"] = concatenate_velocities(velocities) if velocities else None
    return replace(parts[0], **changes)


def merged(pairs: Overlaps, config: MergeSplitConfig) -> list[Group]:
    """Return objects that each cover at least two tracks, and larger than any of them."""
    covering = pairs.of_track >= config.min_overlap
    row, track = pairs.object[covering], pairs.track[covering]
    whole, areas = pairs.object_area_m2, pairs.track_area_m2[track]
    largest = np.zeros(len(whole))
    np.maximum.at(largest, row, areas)
    # tracks on top of each other are duplicates of one object, not neighbours
    apart = np.bincount(row, areas, len(whole)) <= DUPLICATE_AREA_RATIO * whole
    several = np.bincount(row, minlength=len(whole)) > 1
    is_merge = several & apart & (whole > config.max_growth * largest)
    return [Group(k, track[row == k]) for k in np.flatnonzero(is_merge).tolist()]


def parents(pairs: Overlaps, born: I64, min_overlap: float) -> dict[int, int]:
    """Return the track whose predicted hull holds most of a new object, by row of the object."""
    new = np.zeros(len(pairs.object_area_m2), np.bool_)
    new[born] = True
    mine = np.flatnonzero(new[pairs.object] & (pairs.of_object >= min_overlap))
    order = mine[np.lexsort((pairs.track[mine], -pairs.of_object[mine], pairs.object[mine]))]
    rows, first = np.unique(pairs.object[order], return_index=True)
    return dict(zip(rows.tolist(), pairs.track[order[first]].tolist(), strict=True))
