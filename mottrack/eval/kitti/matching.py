"""Matching of one sequence, and what is left out of the counts."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval.kitti.labels import KittiBoxes
from mottrack.eval.kitti.rules import NEIGHBOURS, KittiRules
from mottrack.geometry.iou import iou_3d
from mottrack.geometry.rectangles import rectangle_area, rectangle_iou, shared_area

_FORBIDDEN = 1e9


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
    """(P,) too small, of a neighbour class, or in a region nobody labelled; counts if unmatched."""


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
    """Selects the class and computes all overlaps of a sequence."""
    kinds = (rules.kind, *NEIGHBOURS[rules.kind])
    truth = _by_frame(labels.select(np.isin(labels.kind, kinds) & (labels.id >= 0)))
    tracks = _by_frame(results.select(np.isin(results.kind, kinds)))
    listed = np.unique(np.concatenate([truth.frame, tracks.frame]))
    truth_edges, track_edges = (
        np.append(np.searchsorted(b.frame, listed), len(b)) for b in (truth, tracks)
    )
    measure = iou_3d if rules.measure == "3d" else rectangle_iou
    sides = ("box", "box") if rules.measure == "3d" else ("image_box", "image_box")
    a, b = getattr(truth, sides[0]), getattr(tracks, sides[1])
    overlaps = [
        measure(
            a[truth_edges[f] : truth_edges[f + 1]],
            b[track_edges[f] : track_edges[f + 1]],
        )
        for f in range(len(listed))
    ]
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
    """(P,) each result box's score replaced by the mean over its track, summed in time order."""
    _, track = np.unique(sequence.tracks.id, return_inverse=True)
    mean: F64 = np.bincount(track, score) / np.maximum(np.bincount(track), 1)
    means: F64 = mean[track]
    return means


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
    """Matches every frame by the largest total overlap, without regard to earlier frames.

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
