"""Rules of the protocol, matching of one sequence, and what is left out of the counts."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval.assignment import linear_sum_assignment
from mottrack.eval.kitti.boxes import KittiBoxes
from mottrack.geometry.iou import iou_3d
from mottrack.geometry.rectangles import rectangle_area, rectangle_iou, shared_area

Measure = Literal["3d", "2d"]

VAL_SEQUENCES = (
    "0001", "0006", "0008", "0010", "0012", "0013", "0014", "0015", "0016", "0018", "0019",
)  # fmt: skip
SPLITS = {
    "val": VAL_SEQUENCES,
    "train": tuple(f"{n:04d}" for n in range(21) if f"{n:04d}" not in VAL_SEQUENCES),
    "trainval": tuple(f"{n:04d}" for n in range(21)),
}
"""Sequences of KITTI's training half; "val" is the one of AB3DMOT's tables."""
CLASSES = ("car", "pedestrian", "cyclist")
NEIGHBOURS = {"car": ("van",), "pedestrian": ("person_sitting",), "cyclist": ()}
"""Classes so near that neither finding nor missing one of them counts."""
DEFAULT_IOU: dict[Measure, float] = {"3d": 0.25, "2d": 0.5}
"""Of AB3DMOT's tables, and of KITTI's own 2-D evaluation."""


@dataclass(frozen=True, slots=True)
class KittiRules:
    """What is evaluated and how."""

    kind: str = "car"
    """The class, lower case."""
    measure: Measure = "3d"
    """Overlap of boxes in space, or of their rectangles in the image."""
    min_iou: float = 0.25
    max_occlusion: float = 2
    """True boxes that are hidden more than "largely" are ignored."""
    max_truncation: float = 0
    """True boxes that are cut off by the image are ignored."""
    min_height_px: float = 25
    """Result boxes lower than this that match nothing are not false positives."""
    dont_care_share: float = 0.5
    """Neither are those with more than this share of their area in one "DontCare" region."""
    levels: int = 40
    """Recall levels, from 1 / 40 to 1."""


_FORBIDDEN = 1e9
"""Cost of a pair below the least IoU; allowed ones cost at most 1."""


@dataclass(frozen=True, slots=True)
class Sequence:
    """One sequence prepared for passes at many thresholds: all overlaps are known."""

    truth: KittiBoxes
    """Boxes of the class and its neighbours, by frame."""
    tracks: KittiBoxes
    """Result boxes, by frame."""
    overlaps: list[F64]
    """(truth, tracks) IoU of each of F frames, those that hold a box of either side."""
    truth_edges: I64
    """(F + 1,) first true box of each frame."""
    track_edges: I64
    """(F + 1,) first result box of each frame."""
    ignored_truth: Mask
    """(G,) hidden or cut off, or of a neighbour class."""
    ignored_tracks: Mask
    """(P,) too small, of a neighbour class, or in a region without labels: no false positive."""


@dataclass(frozen=True, slots=True)
class Match:
    """The result of one pass."""

    track_row: I64
    """(G,) matched result box, -1 for none."""
    iou: F64
    """(G,) overlap of the match, 0 for none."""
    active: Mask
    """(P,) result boxes of tracks that reach the threshold."""


def prepare(labels: KittiBoxes, results: KittiBoxes, rules: KittiRules) -> Sequence:
    """Select the class and compute all overlaps of a sequence."""
    kinds = (rules.kind, *NEIGHBOURS[rules.kind])
    truth = _by_frame(labels.select(np.isin(labels.kind, kinds) & (labels.id >= 0)))
    tracks = _by_frame(results.select(np.isin(results.kind, kinds)))
    listed = np.unique(np.concatenate([truth.frame, tracks.frame]))
    truth_edges, track_edges = (
        np.append(np.searchsorted(b.frame, listed), len(b)) for b in (truth, tracks)
    )
    in_space = rules.measure == "3d"
    iou = iou_3d if in_space else rectangle_iou
    rows, columns = (
        np.split(b.box if in_space else b.image_box, edges[1:-1])
        for b, edges in ((truth, truth_edges), (tracks, track_edges))
    )
    overlaps = [iou(a, b) for a, b in zip(rows, columns, strict=True)] if len(listed) else []
    hidden = (truth.occlusion > rules.max_occlusion) | (truth.truncation > rules.max_truncation)
    return Sequence(
        truth,
        tracks,
        overlaps,
        truth_edges,
        track_edges,
        ignored_truth=hidden | (truth.kind != rules.kind),
        ignored_tracks=_ignored_tracks(labels, tracks, rules),
    )


def _by_frame(boxes: KittiBoxes) -> KittiBoxes:
    return boxes.select(np.argsort(boxes.frame, kind="stable"))


def mean_over_tracks(sequence: Sequence, score: F64) -> F64:
    """Return the mean score of each result box's track (P,), summed in order of time."""
    _, track = np.unique(sequence.tracks.id, return_inverse=True)
    return (np.bincount(track, score) / np.maximum(np.bincount(track), 1))[track]


def _ignored_tracks(labels: KittiBoxes, tracks: KittiBoxes, rules: KittiRules) -> Mask:
    height = np.abs(tracks.image_box[:, 1] - tracks.image_box[:, 3])
    ignored: Mask = (height <= rules.min_height_px) | (tracks.kind != rules.kind)
    regions = labels.select(labels.kind == "dontcare")
    for row in np.flatnonzero(~ignored):
        near = regions.image_box[regions.frame == tracks.frame[row]]
        own = tracks.image_box[row][None]
        enough = rules.dont_care_share * rectangle_area(own)[:, None]
        ignored[row] = (shared_area(own, near) > enough).any()
    return ignored


def match(sequence: Sequence, active: Mask, min_iou: float) -> Match:
    """Match every frame by the largest total overlap, without regard to earlier frames.

    `active` (P,) are the result boxes that take part.
    """
    count = len(sequence.truth)
    out = Match(np.full(count, -1), np.zeros(count), active)
    for f, overlap in enumerate(sequence.overlaps):
        first = sequence.track_edges[f]
        columns = np.flatnonzero(out.active[first : sequence.track_edges[f + 1]])
        allowed = overlap[:, columns]
        if not (allowed >= min_iou).any():
            continue
        cost = np.where(allowed >= min_iou, 1.0 - allowed, _FORBIDDEN)
        i, j = linear_sum_assignment(cost)
        good = cost[i, j] < _FORBIDDEN
        rows = sequence.truth_edges[f] + i[good]
        out.track_row[rows] = first + columns[j[good]]
        out.iou[rows] = allowed[i[good], j[good]]
    return out
