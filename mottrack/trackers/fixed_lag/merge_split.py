"""Clusters that fall apart or run together, so that a track survives both.

A split: an occlusion cuts an object, its pieces lie inside the hull that the track predicts. As
long as their common hull is no larger than that, they are one measurement. Pieces that leave the
hull become tracks of their own and inherit the velocity.

A merge: two neighbours are close enough to be one component. Its centre belongs to neither, so it
is no measurement; the tracks coast until the components part again, or until `hold_s` is over.
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
from mottrack.trackers.fixed_lag.config import MergeSplitConfig


class HullList(NamedTuple):
    """Convex, counter-clockwise hulls of N things, one after the other."""

    corner_m: F64
    """(sum K, 2)."""
    start: I64
    """(N + 1,) first corner of each."""

    def polygons(self) -> tuple[F64, ...]:
        """The corners (K, 2) of each."""
        return tuple(self.corner_m[a:b] for a, b in pairwise(self.start.tolist()))


def flat(hulls: Sequence[F64]) -> HullList:
    """Hulls (K, 2) in one list."""
    start = np.zeros(len(hulls) + 1, np.int64)
    np.cumsum([len(hull) for hull in hulls], out=start[1:])
    return HullList(np.concatenate(hulls) if hulls else np.zeros((0, 2)), start)


@dataclass(frozen=True, eq=False)
class Overlaps:
    """How predicted hulls of tracks (N) and hulls of objects (M) lie in each other."""

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
        return np.asarray(self.area_m2 / self.track_area_m2[self.track])

    @property
    def of_object(self) -> F64:
        """(P,) share of the object's hull that lies in the track's."""
        return np.asarray(self.area_m2 / self.object_area_m2[self.object])

    @property
    def iou(self) -> F64:
        """(P,) intersection over union."""
        union = self.track_area_m2[self.track] + self.object_area_m2[self.object] - self.area_m2
        return np.asarray(self.area_m2 / union)


def no_overlaps(tracks: int, objects: int) -> Overlaps:
    """What is said of boxes, which do not fall apart or run together."""
    none = np.zeros(0, np.int64)
    return Overlaps(none, none, np.zeros(0), np.ones(tracks), np.ones(objects))


def overlaps(tracks: HullList, objects: HullList) -> Overlaps:
    """All overlapping pairs of two sets of hulls, in one frame."""
    (area_one, box_one), (area_other, box_other) = _extents(*tracks), _extents(*objects)
    pairs = _near(box_one, box_other)
    area = _shared(*tracks, *objects, pairs)
    kept = area > 0.0
    return Overlaps(pairs[0][kept], pairs[1][kept], area[kept], area_one, area_other)


@compiled
def _near(one: F64, other: F64) -> tuple[I64, I64]:
    """Pairs whose bounds overlap, in the order of the first."""
    first, second = np.empty(64, np.int64), np.empty(64, np.int64)
    count = 0
    for i in range(len(one)):
        for j in range(len(other)):
            apart = one[i, 0] > other[j, 2] or one[i, 2] < other[j, 0]
            if apart or one[i, 1] > other[j, 3] or one[i, 3] < other[j, 1]:
                continue
            if count == len(first):
                first = np.concatenate((first, np.empty_like(first)))
                second = np.concatenate((second, np.empty_like(second)))
            first[count], second[count] = i, j
            count += 1
    return first[:count], second[:count]


@compiled
def _extents(corner: F64, start: I64) -> tuple[F64, F64]:
    """Area (N,), at least 1e-6, and bounds (N, 4): low x, low y, high x, high y."""
    area, box = np.zeros(len(start) - 1), np.zeros((len(start) - 1, 4))
    for h in range(len(area)):
        first, last = start[h], start[h + 1]
        x, y = corner[first, 0], corner[first, 1]
        twice, low_x, low_y, high_x, high_y = 0.0, x, y, x, y
        for k in range(first, last):
            after = k + 1 if k + 1 < last else first
            twice += (corner[k, 0] - x) * (corner[after, 1] - y)
            twice -= (corner[k, 1] - y) * (corner[after, 0] - x)
            low_x, high_x = min(low_x, corner[k, 0]), max(high_x, corner[k, 0])
            low_y, high_y = min(low_y, corner[k, 1]), max(high_y, corner[k, 1])
        area[h] = max(0.5 * abs(twice), 1e-6)
        box[h, 0], box[h, 1], box[h, 2], box[h, 3] = low_x, low_y, high_x, high_y
    return area, box


@compiled
def _shared(a: F64, a_start: I64, b: F64, b_start: I64, pairs: tuple[I64, I64]) -> F64:
    """(P,) area shared by the hulls of each pair, about a common origin."""
    area = np.zeros(len(pairs[0]))
    for p in range(len(area)):
        i, j = pairs[0][p], pairs[1][p]
        origin = a[a_start[i]].copy()
        one = a[a_start[i] : a_start[i + 1]] - origin
        two = b[b_start[j] : b_start[j + 1]] - origin
        area[p] = clip_area(one, two, np.empty((2, len(one) + len(two) + 1, 2)))
    return area


def fragments(pairs: Overlaps, config: MergeSplitConfig) -> list[tuple[int, I64]]:
    """Tracks whose predicted hull holds at least two objects that fit no other track better."""
    if len(pairs.track) == 0:
        return []
    order = np.lexsort((-pairs.iou, pairs.object))
    _, first = np.unique(pairs.object[order], return_index=True)
    best = order[first]
    small = pairs.object_area_m2[pairs.object[best]] < pairs.track_area_m2[pairs.track[best]]
    inside = best[(pairs.of_object[best] >= config.inside_share) & small]
    return _groups(pairs.track[inside], pairs.object[inside])


def _groups(owner: I64, member: I64) -> list[tuple[int, I64]]:
    """Owners with at least two members, and those."""
    order = np.argsort(owner, kind="stable")
    owners, first, count = np.unique(owner[order], return_index=True, return_counts=True)
    members = np.split(member[order], first[1:])
    return [(int(owners[k]), members[k]) for k in np.flatnonzero(count > 1).tolist()]


def joined(
    objects: Objects, groups: list[tuple[int, I64]], track_area_m2: F64, growth: float
) -> Objects:
    """The objects with each group replaced by one, where its hull does not outgrow the track's."""
    gone: list[int] = []
    rows: list[Objects] = []
    for track, group in groups:
        one = _joined(objects, group)
        limit_m2 = growth * track_area_m2[track]
        if one.hull is not None and polygon_area(one.hull[0]) <= limit_m2:
            gone.extend(group.tolist())
            rows.append(one)
    if not rows:
        return objects
    kept = objects.select(~np.isin(np.arange(len(objects)), gone))
    return _stacked([kept, *rows])


def _joined(objects: Objects, group: I64) -> Objects:
    """One object with the common hull of a group; other fields come from its largest piece."""
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
    size_m = np.append(np.maximum(hull.rectangle[0, 2:4], 0.1), high - low)
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
    """All rows of several sets of objects that have the same fields."""
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


def merged(pairs: Overlaps, config: MergeSplitConfig) -> list[tuple[int, I64]]:
    """Objects that each swallowed at least two tracks, with the rows of those tracks."""
    covering = pairs.of_track >= config.inside_share
    row, track = pairs.object[covering], pairs.track[covering]
    whole, areas = pairs.object_area_m2, pairs.track_area_m2[track]
    largest = np.zeros(len(whole))
    np.maximum.at(largest, row, areas)
    # tracks on top of each other are duplicates of one object, not neighbours
    apart = np.bincount(row, areas, len(whole)) <= 1.2 * whole
    several = np.bincount(row, minlength=len(whole)) > 1
    swallowed = several & apart & (whole > config.growth * largest)
    return [(k, track[row == k]) for k in np.flatnonzero(swallowed).tolist()]


def parents(pairs: Overlaps, born: I64, share: float) -> dict[int, int]:
    """The track whose predicted hull holds most of a new object, by row of the object."""
    new = np.zeros(len(pairs.object_area_m2), np.bool_)
    new[born] = True
    mine = np.flatnonzero(new[pairs.object] & (pairs.of_object >= share))
    order = mine[np.lexsort((pairs.track[mine], -pairs.of_object[mine], pairs.object[mine]))]
    rows, first = np.unique(pairs.object[order], return_index=True)
    return dict(zip(rows.tolist(), pairs.track[order[first]].tolist(), strict=True))
