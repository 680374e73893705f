"""What detections and measured velocities say of every track box, and what labels say there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.scene_objects import SceneObjects
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.flow_error import GROSS_MPS

AGREE_M = 1.0
"""A detection nearer than this to a track is of the same object: half of nuScenes' gate."""
APART_M = 2.0
"""A label nearer than this to a track may be its object: nuScenes' gate."""
USUAL = 0.25
"""Quantile of the scores of labelled detections from which one is sure: the median would leave half
of the frames of a good track out."""
_FRAMES_APART_M = 1e6
"""Frames are laid side by side at this distance, farther than a scene extends, to search all of
them at once."""


class Nearest(NamedTuple):
    """Of each of N boxes the nearest other box in its frame."""

    row: I64
    """(N,) -1 where the frame has none within the limit."""
    distance_m: F64
    """(N,) infinite there."""


@dataclass(frozen=True)
class Evidence:
    """What is known beside N track boxes."""

    detection: Nearest
    """Of the same class, within `AGREE_M`."""
    sure: Mask
    """(N,) whether its score is that of a usual detection of a labelled object, or higher."""
    flow_mps: F64
    """(N, 2) velocity measured of the detection, NaN where none was."""
    flow: Mask
    """(N,) whether it agrees with the track's to 1 m/s."""
    label: Nearest
    """True box of any class, within `APART_M` or half the diagonal of the track's box."""

    @classmethod
    def of(cls, tracks: TrackTable, objects: SceneObjects, truth: TruthTable) -> Evidence:
        """Look up the evidence of track boxes of one scene.

        Args:
            tracks: the boxes.
            objects: what the tracker received; without classes where the tracks have none.
            truth: every label of the scene.
        """
        detection = nearest(tracks, objects, AGREE_M, by_label=True)
        there = detection.row >= 0
        row = np.where(there, detection.row, 0)
        flow_mps, sure = np.full((len(tracks), 2), np.nan), np.zeros(len(tracks), np.bool_)
        if len(objects):
            flow_mps = np.where(there[:, None], objects.velocity_mps[row], np.nan)
            sure = there & (objects.score[row] >= _usual_scores(objects, truth)[row])
        apart_mps = np.hypot(*(flow_mps - tracks.velocity_mps).T)
        # a long box (a bus, a trailer) is labelled about another centre than it is tracked
        reach_m = np.maximum(APART_M, np.hypot(*tracks.size_m[:, :2].T) / 2)
        label = nearest(tracks, truth, reach_m)
        return cls(detection, sure, flow_mps, apart_mps <= GROSS_MPS, label)


def nearest(
    boxes: TrackTable,
    others: TruthTable | SceneObjects,
    limit_m: float | F64,
    *,
    by_label: bool = False,
) -> Nearest:
    """Return the nearest other box over the ground in the frame of each box.

    Args:
        boxes: (N,) of one scene.
        others: of the same scene.
        limit_m: farther ones do not count; of all, or (N,) of each.
        by_label: whether it must be of the same class.
    """
    row, distance_m = np.full(len(boxes), -1), np.full(len(boxes), np.inf)
    groups = np.unique(boxes.label) if by_label else [None]
    for group in groups:
        mine = np.flatnonzero(boxes.label == group) if by_label else np.arange(len(boxes))
        theirs = np.flatnonzero(others.label == group) if by_label else np.arange(len(others))
        if len(mine) and len(theirs):
            tree = KDTree(_side_by_side(others.frame[theirs], others.centre_m[theirs]))
            apart, index = tree.query(_side_by_side(boxes.frame[mine], boxes.centre_m[mine]))
            distance_m[mine], row[mine] = apart, theirs[index]
    near = distance_m < limit_m
    return Nearest(np.where(near, row, -1), np.where(near, distance_m, np.inf))


def _side_by_side(frame: I64, centre_m: F64) -> F64:
    return np.column_stack([centre_m[:, 0] + frame * _FRAMES_APART_M, centre_m[:, 1]])


def _usual_scores(objects: SceneObjects, truth: TruthTable) -> F64:
    """Return the lower quartile of the scores of labelled detections of each one's class, (D,).

    Infinite where no detection of the class has one.
    """
    usual = np.full(len(objects), np.inf)
    tree = KDTree(_side_by_side(truth.frame, truth.centre_m)) if len(truth) else None
    if tree is None:
        return usual
    apart, _ = tree.query(_side_by_side(objects.frame, objects.centre_m))
    for label in np.unique(objects.label):
        own = objects.label == label
        labelled = own & (apart < APART_M)
        if labelled.any():
            usual[own] = np.quantile(objects.score[labelled], USUAL)
    return usual
