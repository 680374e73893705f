"""Training examples: pairs of sweeps prepared as at inference, with the motion of every point.

Labels come from the embedded world, or from annotated tracks (paper, section III-C): "We estimate
the instantaneous velocity from the difference in object positions divided by the elapsed time
between consecutive frames"; here with the change of heading too, so that the corners of a turning
bus move as they do. Everything without a track has velocity zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F32, F64, I8, I16, I64, U8, Mask
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.objects import Truth
from mottrack.core.pose import rotation_2d
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.flow.pillarflow.pillars import (
    cell_of_centres,
    network_cells,
    network_points,
    visibility_shares,
)
from mottrack.flow.pillarflow.sight import point_sight
from mottrack.flow.pillarflow.source import points_of
from mottrack.flow.stages import Stages, StagesConfig
from mottrack.flow.sweep_pair import GroundStage
from mottrack.lidar.in_boxes import points_in_boxes

EXAMPLE_GRID = BevGrid(cell_m=0.5)
"""The visibility rasters of an example lie on this grid."""
HALF_WIDTH_M = 54.5
"""Points further off in x or y are left out: the grid's 50 m and what enters in an interval."""
MARGIN_M = 0.15
"""Annotated boxes are tight and a few centimetres off; their surface points lie within this."""


@dataclass(frozen=True)
class Labels:
    """Truth of a pair of sweeps, for every point of the raw sweeps (not yet prepared)."""

    previous_object: I16
    """(N_previous,) row of the object that the point lies on, -1: background."""
    current_object: I16
    """(N_current,) the same for the current sweep."""
    velocity_mps: F32
    """(N_current,2) velocity over the ground of each current point, current ego axes."""
    centre_m: F32
    """(K,2+S,2) centre (x, y) of each object in the previous, the current and the S older sweeps;
    all in the current ego frame."""
    older_object: tuple[I16, ...] = ()
    """The row of the object of each point of every older sweep."""


@dataclass(frozen=True)
class LabelledPair:
    """Two sweeps and older ones, each in its own ego frame, and the truth of every point."""

    previous: Sweep
    current: Sweep
    labels: Labels
    older: tuple[Sweep, ...] = ()
    """S further sweeps of the past, from the youngest to the oldest."""


@dataclass(frozen=True)
class Example:
    """A prepared pair, everything in the current ego frame."""

    previous: F32
    """(N,4) x, y, height above ground [m], reflectance."""
    current: F32
    """(M,4) the same of the current sweep."""
    previous_object: I16
    """(N,) row of the object, -1: background."""
    current_object: I16
    """(M,) the same of the current sweep."""
    motion_m: F32
    """(M,2) displacement of each current point over the ground since the previous sweep."""
    centre_m: F32
    """(K,2,2) centres of the objects, previous and current."""
    seen: U8
    """(4,H,W) on EXAMPLE_GRID, in percent: unseen and seen-free of current, then previous."""
    elapsed_s: float
    """Time between the sweeps."""
    previous_sight: I8
    """(N,) UNSEEN, FREE or OCCUPIED: what the current sweep saw at the place of each point."""
    current_sight: I8
    """(M,) the same of the previous sweep and the current points."""
    older: F32
    """(P,4) points of all older sweeps, as `previous`."""
    older_object: I16
    """(P,) row of the object, -1: background."""
    older_slot: U8
    """(P,) which of the older sweeps the point is of, the youngest is 0."""
    older_age_s: F64
    """(S,) time between each older sweep and the current one."""

    def select(self, previous: Mask, current: Mask) -> Example:
        """Return the example with these points of either sweep, masks (N,) and (M,)."""
        return replace(
            self,
            previous=self.previous[previous],
            previous_object=self.previous_object[previous],
            previous_sight=self.previous_sight[previous],
            current=self.current[current],
            current_object=self.current_object[current],
            current_sight=self.current_sight[current],
            motion_m=self.motion_m[current],
        )

    def select_older(self, older: Mask) -> Example:
        """Return the example with these points of the older sweeps, mask (P,)."""
        return replace(
            self,
            older=self.older[older],
            older_object=self.older_object[older],
            older_slot=self.older_slot[older],
        )


class ExampleBuilder:
    """Prepares labelled pairs with the stages of inference."""

    def __init__(self, *, remove_ground: bool) -> None:
        """Make the stages; without `remove_ground` the ground's points stay."""
        self.grid = BevGrid()
        stages = StagesConfig(ground=GroundStage(enabled=remove_ground))
        self.stages = Stages(stages, self.grid)
        self._cells = network_cells(EXAMPLE_GRID, EXAMPLE_GRID.cell_m, 1)
        self._index = cell_of_centres(self.grid, self._cells)

    def build(self, labelled: LabelledPair) -> Example:
        """Prepare a pair and join it with its labels, cut to `HALF_WIDTH_M`."""
        labels = labelled.labels
        past = [_numbered(sweep) for sweep in (*labelled.older[::-1], labelled.previous)]
        pair = self.stages.before(past, _numbered(labelled.current))
        previous, current, sight = pair.previous, pair.current, point_sight(pair)
        older = pair.past[-2::-1]
        rows = _rows(current)
        shares = visibility_shares(pair.current_seen, pair.previous_seen, self._index, self._cells)
        example = Example(
            previous=network_points(previous.xyz_m, pair.previous_height_m, previous.reflectance),
            current=network_points(current.xyz_m, pair.current_height_m, current.reflectance),
            previous_object=labels.previous_object[_rows(previous)],
            current_object=labels.current_object[rows],
            motion_m=(labels.velocity_mps[rows] * pair.elapsed_s).astype(np.float32),
            centre_m=labels.centre_m,
            seen=np.round(100 * shares).astype(np.uint8),
            elapsed_s=pair.elapsed_s,
            previous_sight=sight.previous,
            current_sight=sight.current,
            older=_joined([points_of(sweep) for sweep in older]),
            older_object=np.concatenate(
                [
                    np.zeros(0, np.int16),
                    *(
                        of[_rows(sweep.obstacles)]
                        for of, sweep in zip(labels.older_object, older, strict=True)
                    ),
                ]
            ),
            older_slot=np.repeat(
                np.arange(len(older)), [len(sweep.obstacles) for sweep in older]
            ).astype(np.uint8),
            older_age_s=np.array([sweep.elapsed_s for sweep in older], np.float64),
        )
        example = example.select(_near(example.previous), _near(example.current))
        return example.select_older(_near(example.older))


def _joined(points: list[F32]) -> F32:
    return np.concatenate([np.zeros((0, 4), np.float32), *points])


def _near(points: F32) -> Mask:
    near: Mask = np.abs(points[:, :2]).max(axis=1, initial=0.0) < HALF_WIDTH_M
    return near


def _numbered(sweep: Sweep) -> Sweep:
    """Put row numbers into `time_offset_ns`, by which points are found after the stages."""
    return replace(sweep, time_offset_ns=np.arange(len(sweep), dtype=np.int64), ring=None)


def _rows(sweep: Sweep) -> I64:
    if sweep.time_offset_ns is None:
        raise InputError("time_offset_ns", None, "row numbers that the stages kept")
    return sweep.time_offset_ns


class BoxedSweep(NamedTuple):
    """A sweep in its own ego frame and the boxes at its stamp, in any frame of `Truth`."""

    sweep: Sweep
    truth: Truth


def labels_from_tracks(
    previous: BoxedSweep, current: BoxedSweep, older: Sequence[BoxedSweep] = ()
) -> Labels:
    """Return the labels of the sweeps of an example from the boxes at their stamps.

    Objects without a box in both sweeps of the pair get a centre of their own but no velocity; one
    without a box in an older sweep has none of its points there.
    """
    sweep, now = current.sweep, _boxes(current, current.sweep)
    rows_now = _on_boxes(sweep.xyz_m, now)
    past = [_past_objects(one, sweep, now) for one in (previous, *older)]
    then = _boxes(previous, sweep)
    _, in_now, in_then = np.intersect1d(now.id, then.id, return_indices=True)
    motion_m = np.zeros((len(sweep), 2), np.float32)
    for row, before in zip(in_now, in_then, strict=True):
        on = rows_now == row
        rotation = rotation_2d(float(then.yaw_rad[before] - now.yaw_rad[row]))
        offset = sweep.xyz_m[on, :2] - now.centre_m[row, :2]
        motion_m[on] = sweep.xyz_m[on, :2] - (offset @ rotation.T + then.centre_m[before, :2])
    elapsed_s = seconds_between(previous.sweep.stamp_ns, sweep.stamp_ns)
    centres_m = [past[0].centre_m, now.centre_m[:, :2], *(one.centre_m for one in past[1:])]
    return Labels(
        previous_object=past[0].object_of,
        current_object=rows_now.astype(np.int16),
        velocity_mps=motion_m / np.float32(elapsed_s),
        centre_m=np.stack(centres_m, axis=1).astype(np.float32),
        older_object=tuple(one.object_of for one in past[1:]),
    )


class _PastObjects(NamedTuple):
    """The objects of the current sweep in an earlier one."""

    object_of: I16
    """(N,) row of each point's object in the current truth, -1: none."""
    centre_m: F64
    """(K, 2) where each was, current ego frame; where it is now, if it has no box there."""


def _past_objects(then: BoxedSweep, current: Sweep, now: Truth) -> _PastObjects:
    boxes = _boxes(then, current)
    rows = _on_boxes(then.sweep.seen_from(current).xyz_m, boxes)
    _, in_now, in_then = np.intersect1d(now.id, boxes.id, return_indices=True)
    row_in_now = np.full(len(boxes) + 1, -1, np.int16)  # the last is for points on no box
    row_in_now[in_then] = in_now
    centre_m = np.array(now.centre_m[:, :2])
    centre_m[in_now] = boxes.centre_m[in_then, :2]
    return _PastObjects(row_in_now[rows], centre_m)


def _boxes(boxed: BoxedSweep, current: Sweep) -> Truth:
    """Return the boxes in the current ego frame."""
    truth = boxed.truth
    return (
        truth if truth.frame == "ego" else truth.transformed(current.world_T_ego.inverse(), "ego")
    )


def _on_boxes(xyz_m: F32, boxes: Truth) -> I64:
    inside = points_in_boxes(xyz_m, boxes.centre_m, boxes.size_m, boxes.yaw_rad, MARGIN_M)
    return inside.first_box(len(xyz_m))
