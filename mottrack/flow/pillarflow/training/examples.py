"""Training examples: pairs of sweeps prepared as at inference, with the motion of every point.

Labels come from the embedded world, or from annotated tracks (paper, section III-C): "We estimate
the instantaneous velocity from the difference in object positions divided by the elapsed time
between consecutive frames"; here with the change of heading too, so that the corners of a turning
bus move as they do. Everything without a track has velocity zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mottrack.core.arrays import F32, I16, I64, U8, Mask
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
from mottrack.flow.stages import Stages, StagesConfig
from mottrack.flow.sweep_pair import GroundStage
from mottrack.lidar.in_boxes import points_in_boxes

EXAMPLE_GRID = BevGrid(cell_m=0.5)
"""The visibility rasters of an example lie on this grid."""
HALF_WIDTH_M = 50.5
"""Points further off in x or y are left out: the grid's 50 m and one cell."""
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
    """(K,2,2) centre (x, y) of each object in the previous, then the current sweep; all in the
    current ego frame."""


@dataclass(frozen=True)
class LabelledPair:
    """Two sweeps, each in its own ego frame, and the truth of every point of both."""

    previous: Sweep
    current: Sweep
    labels: Labels


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

    def select(self, previous: Mask, current: Mask) -> Example:
        """Return the example with these points of either sweep, masks (N,) and (M,)."""
        return replace(
            self,
            previous=self.previous[previous],
            previous_object=self.previous_object[previous],
            current=self.current[current],
            current_object=self.current_object[current],
            motion_m=self.motion_m[current],
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
        pair = self.stages.before([_numbered(labelled.previous)], _numbered(labelled.current))
        previous, current = pair.previous, pair.current
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
        )
        return example.select(*(_near(points) for points in (example.previous, example.current)))


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


def labels_from_tracks(
    previous: Sweep, current: Sweep, previous_truth: Truth, current_truth: Truth
) -> Labels:
    """Return the labels of two sweeps from the boxes at their stamps (any frame of `Truth`).

    Objects without a box in both sweeps get a centre of their own but no velocity.
    """
    ego_T_world = current.world_T_ego.inverse()
    then, now = (
        boxes if boxes.frame == "ego" else boxes.transformed(ego_T_world, "ego")
        for boxes in (previous_truth, current_truth)
    )
    rows_then, rows_now = (
        points_in_boxes(
            sweep.xyz_m, boxes.centre_m, boxes.size_m, boxes.yaw_rad, MARGIN_M
        ).first_box(len(sweep))
        for sweep, boxes in ((previous.seen_from(current), then), (current, now))
    )
    _, in_now, in_then = np.intersect1d(now.id, then.id, return_indices=True)
    row_in_now = np.full(len(then) + 1, -1, np.int16)  # the last is for points on no box
    row_in_now[in_then] = in_now
    centre_m = np.stack([now.centre_m[:, :2]] * 2, axis=1)
    centre_m[in_now, 0] = then.centre_m[in_then, :2]
    motion_m = np.zeros((len(current), 2), np.float32)
    for row, before in zip(in_now, in_then, strict=True):
        on = rows_now == row
        rotation = rotation_2d(float(then.yaw_rad[before] - now.yaw_rad[row]))
        offset = current.xyz_m[on, :2] - now.centre_m[row, :2]
        motion_m[on] = current.xyz_m[on, :2] - (offset @ rotation.T + then.centre_m[before, :2])
    elapsed_s = seconds_between(previous.stamp_ns, current.stamp_ns)
    return Labels(
        previous_object=row_in_now[rows_then],
        current_object=rows_now.astype(np.int16),
        velocity_mps=motion_m / np.float32(elapsed_s),
        centre_m=centre_m.astype(np.float32),
    )
