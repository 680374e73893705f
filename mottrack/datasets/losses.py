"""What of a scene is not as it was in another copy of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mottrack.core import Boxes, Frame, Objects, Pose, Scene, Sweep, Truth
from mottrack.core.pose import wrap_angle

NEAR_M = 0.5
"""A box and its copy are this near: formats round to millimetres, and objects are farther apart."""
STILL_M, STILL_RAD = 1e-6, 1e-6
"""Smaller differences are those of floating-point numbers."""
STILL_POINT_M = 1e-4
"""Points are float32 in the frame of a sensor: 100 m have steps of 8e-6 m, and move twice."""
STILL_REFLECTANCE = 1e-6
STILL_US = 1.0
"""A double counts seconds since 1970 in steps of 0.2 microseconds."""


class Loss(NamedTuple):
    """What differs, how often, out of how many, and by how much at most where that is a number."""

    what: str
    number: int
    of: int
    most: str = ""

    def __str__(self) -> str:
        return f"{self.what}: {self.number} of {self.of}" + (f", {self.most}" if self.most else "")


@dataclass
class _Tally:
    """Counts by what is lost; `of` counts what was looked at."""

    lost: Counter[str] = field(default_factory=Counter)
    of: Counter[str] = field(default_factory=Counter)
    most: dict[str, float] = field(default_factory=dict)
    examples: dict[str, str] = field(default_factory=dict)

    def add(self, what: str, lost: int, of: int) -> None:
        """Count `lost` of `of` boxes or values that a format has no place for."""
        self.lost[what] += lost
        self.of[what] += of

    def moved(self, what: str, by: float, least: float) -> None:
        """Count one that was looked at, and as lost if it moved by more than the least."""
        self.add(what, int(by > least), 1)
        self.most[what] = max(by, self.most.get(what, 0.0))

    def losses(self, units: dict[str, str]) -> Iterator[Loss]:
        """Yield what was lost, with the largest difference in its unit."""
        for what, count in self.lost.items():
            if count:
                most = self.examples.get(what, "")
                if what in self.most:
                    most = f"by up to {self.most[what]:.3g} {units[what]}"
                yield Loss(what, count, self.of[what], most)


BOXES_MOVED = "{} moved, resized or turned"
UNITS = {
    "stamps moved": "us",
    "poses moved": "m",
    "points moved": "m",
    "times of points moved": "us",
    "reflectances rounded": "of 1",
    BOXES_MOVED.format("true boxes"): "m",
    BOXES_MOVED.format("detections"): "m",
}
"""Unit of what is measured."""


def scene_losses(before: Scene, after: Scene) -> Iterator[Loss]:
    """Yield what of a scene is not in its copy, or is not the same there.

    Frames are matched by the time since the first. Places are compared in the frame of the
    vehicle, since the world of some formats is another.

    Args:
        before: the scene.
        after: its copy.
    """
    tally = _Tally()
    pairs = _pairs(before, after)
    tally.add("frames", len(before) - len(pairs), len(before))
    if pairs:
        first = _frames(before, after, pairs[0])
        world = first.after.world_T_ego @ first.before.world_T_ego.inverse()
        if _difference(world, Pose.identity()) > 1e-4:
            tally.add("world: it starts elsewhere, poses are those of another frame", 1, 1)
        for pair in pairs:
            both = _frames(before, after, pair)
            _compare_frames(tally, both, first, world)
            _compare_sweeps(tally, before, after, pair)
    yield from tally.losses(UNITS)


class _Both(NamedTuple):
    """A frame and its copy."""

    before: Frame
    after: Frame


class _Pair(NamedTuple):
    """The indices of a frame and its copy."""

    before: int
    after: int


def _frames(before: Scene, after: Scene, pair: _Pair) -> _Both:
    return _Both(before.frame(pair.before), after.frame(pair.after))


def _pairs(before: Scene, after: Scene) -> list[_Pair]:
    """Return the frames that are in both: those nearest in time since the first, each once."""
    stamps = [
        np.array([scene.frame(i).stamp_ns for i in range(len(scene))]) for scene in (before, after)
    ]
    if not len(stamps[0]) or not len(stamps[1]):
        return []
    # the first frames may be lost: KITTI alone counts from its own first frame
    shift = (
        0 if np.isin(stamps[1] // 1000, stamps[0] // 1000).any() else stamps[0][0] - stamps[1][0]
    )
    moved = stamps[1] + shift
    half = (np.median(np.diff(stamps[0])) if len(stamps[0]) > 1 else 1e9) / 2
    found = []
    for index, stamp in enumerate(stamps[0]):
        nearest = int(np.abs(moved - stamp).argmin())
        if abs(moved[nearest] - stamp) < half:
            found.append(_Pair(index, nearest))
    return found


def _compare_frames(tally: _Tally, both: _Both, first: _Both, world: Pose) -> None:
    before, after = both
    since = (f.stamp_ns - start.stamp_ns for f, start in zip(both, first, strict=True))
    one, other = since
    tally.moved("stamps moved", abs(one - other) / 1e3, 0.0)
    if before.stamp_ns // 1000 != after.stamp_ns // 1000:
        tally.add("stamps: counted from another start", 1, 0)
    tally.of["stamps: counted from another start"] += 1
    moved = _difference(world @ before.world_T_ego, after.world_T_ego)
    tally.moved("poses moved", moved, STILL_M)
    view = before.labelled_azimuth_rad
    other_view = view is not None and view != after.labelled_azimuth_rad
    tally.add("views within which objects are labelled", int(other_view), 1)
    tally.add("key frames", int(before.is_key and not after.is_key), int(before.is_key))
    tally.add(
        "frames without labels that have empty ones",
        int(before.truth is None and after.truth is not None),
        1,
    )
    for what, one_boxes, other_boxes in (
        ("true boxes", before.truth, after.truth),
        ("detections", before.detections, after.detections),
    ):
        if one_boxes is not None:
            kept = other_boxes if other_boxes is not None else one_boxes.select(np.zeros(0, int))
            _compare_boxes(
                tally,
                what,
                one_boxes.transformed(before.world_T_ego.inverse(), "ego"),
                kept.transformed(after.world_T_ego.inverse(), "ego"),
            )


def _compare_boxes(tally: _Tally, what: str, before: Boxes, after: Boxes) -> None:
    """Match the boxes of a frame by place and compare what they say."""
    rows = _matched(before, after)
    there = rows >= 0
    tally.add(f"{what} left out", int(np.count_nonzero(~there)), len(before))
    one, other = before.select(there), after.select(rows[there])
    renamed = one.label != other.label
    tally.add(f"labels of {what}", int(renamed.sum()), len(one))
    for old, new in zip(one.label[renamed], other.label[renamed], strict=True):
        example = f"{old} -> {new}"
        shown = tally.examples.setdefault(f"labels of {what}", example)
        if example not in shown.split("; ") and shown.count(";") < 5:
            tally.examples[f"labels of {what}"] = f"{shown}; {example}"
    apart = np.abs(one.centre_m - other.centre_m).max(axis=1, initial=0.0)
    sizes = np.abs(one.size_m - other.size_m).max(axis=1, initial=0.0)
    turned = np.abs(wrap_angle(one.yaw_rad - other.yaw_rad))
    changed = (apart > STILL_M) | (sizes > STILL_M) | (turned > STILL_RAD)
    key = BOXES_MOVED.format(what)
    tally.add(key, int(changed.sum()), len(one))
    largest = np.concatenate([apart, sizes]).max(initial=0.0)
    tally.most[key] = max(float(largest), tally.most.get(key, 0.0))
    if isinstance(one, Objects) and isinstance(other, Objects):
        lost = int(one.velocity.valid.sum()) if one.velocity and not other.velocity else 0
        tally.add(f"velocities of {what}", lost, len(one))
    if isinstance(one, Truth) and isinstance(other, Truth):
        counted = (one.num_points >= 0) & (other.num_points < 0)
        tally.add(f"numbers of points in {what}", int(counted.sum()), len(one))


def _matched(before: Boxes, after: Boxes) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return (N,) the row of the copy that is nearest to each box, -1 without one."""
    found = np.full(len(before), -1, dtype=np.int64)
    if not len(after):
        return found
    apart = np.linalg.norm(before.centre_m[:, None] - after.centre_m[None], axis=2)
    apart += np.abs(before.size_m[:, None] - after.size_m[None]).sum(axis=2)
    free = np.ones(len(after), dtype=bool)
    for row in np.argsort(apart.min(axis=1), kind="stable"):
        nearest = int(np.where(free, apart[row], np.inf).argmin())
        if free[nearest] and apart[row, nearest] < NEAR_M:
            found[row], free[nearest] = nearest, False
    return found


def _compare_sweeps(tally: _Tally, before: Scene, after: Scene, pair: _Pair) -> None:
    if not before.has_sweeps:
        return
    one = before.sweep(pair.before)
    if not after.has_sweeps:
        tally.add("sweeps", 1, 1)
        return
    _compare_points(tally, one, after.sweep(pair.after))


def _compare_points(tally: _Tally, one: Sweep, other: Sweep) -> None:
    tally.add("points", max(0, len(one) - len(other)), len(one))
    if len(one) == len(other):
        tally.moved("points moved", _apart(one, other), STILL_POINT_M)
        rounded = float(np.abs(np.sort(one.reflectance) - np.sort(other.reflectance)).max())
        tally.moved("reflectances rounded", rounded, STILL_REFLECTANCE)
        if one.time_offset_ns is not None and other.time_offset_ns is not None:
            late_ns = np.sort(one.time_offset_ns) - np.sort(other.time_offset_ns)
            tally.moved("times of points moved", float(np.abs(late_ns).max()) / 1e3, STILL_US)
    tally.add("beams of points", int(one.ring is not None and other.ring is None), 1)
    timed = one.time_offset_ns is not None and other.time_offset_ns is None
    tally.add("times of points", int(timed), 1)
    tally.add("places of the sensor", int(np.abs(one.origin_m - other.origin_m).max() > 1e-6), 1)


def _apart(one: Sweep, other: Sweep) -> float:
    """Return how far a point is from its copy at most; formats may store them in another order."""
    apart = float(np.abs(one.xyz_m - other.xyz_m).max())
    if apart > NEAR_M:
        apart = float(np.max(cKDTree(other.xyz_m).query(one.xyz_m)[0]))
    return apart


def _difference(one: Pose, other: Pose) -> float:
    return float(np.abs(one.matrix - other.matrix).max())
