"""HOTA and IDF1 by KITTI's own rules (TrackEval's `kitti_2d_box`), on rectangles or 3-D boxes.

Boxes of a neighbour class and true boxes that are hidden or cut off are distractors: neither they
nor the result boxes that match them count. Result boxes that match nothing are left out where they
are too low or lie in a region without labels. KITTI's server evaluates rectangles in the image at
an IoU of 0.5; with 3-D boxes the rules are the same, with the IoU of `KittiRules`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval import hota, identity
from mottrack.eval.additive import hota_metrics, identity_metrics, sampled
from mottrack.eval.assignment import linear_sum_assignment
from mottrack.eval.hota import HotaCounts
from mottrack.eval.identity import IdentityCounts
from mottrack.eval.kitti.boxes import KittiBoxes
from mottrack.eval.kitti.concerns import Files
from mottrack.eval.kitti.matching import NEIGHBOURS, KittiRules
from mottrack.eval.pairs import BoxStream, Extended, Pairs, find_pairs, iou_gate, overlap
from mottrack.geometry.iou import iou_3d
from mottrack.geometry.rectangles import rectangle_area, rectangle_iou, shared_area

DISTRACTORS = NEIGHBOURS | {"pedestrian": ("person", "person_sitting")}
"""The labels of the tracking data call sitting persons "Person", which AB3DMOT's code does not."""
_ROUNDING = float(np.finfo(np.float64).eps)  # as TrackEval: an overlap of the gate still matches


class IdentitySums(NamedTuple):
    """Of one sequence; they add up."""

    hota: HotaCounts
    identity: IdentityCounts

    def as_dict(self) -> dict[str, float]:
        """Return HOTA and its parts, means over alpha, and IDF1, IDP, IDR."""
        parts = hota.hota(self.hota).as_dict()
        own = self.identity
        return {**parts, "idf1": own.idf1, "idp": own.idp, "idr": own.idr}


def identity_sums(files: Files, rules: KittiRules, threshold: float = -np.inf) -> IdentitySums:
    """Return the sums of one sequence.

    Args:
        files: labels and results.
        rules: class, measure and least overlap.
        threshold: least mean score of a track that takes part; by default all do.
    """
    pairs = counted_pairs(files, rules, threshold)
    near = pairs.within(iou_gate(rules.min_iou))
    return IdentitySums(hota.hota_counts(pairs), identity.identity_counts(near))


def total(sums: list[IdentitySums]) -> IdentitySums:
    """Return the sums of several sequences together."""
    return IdentitySums(hota.total(s.hota for s in sums), identity.total(s.identity for s in sums))


def identity_intervals(sums: list[IdentitySums], weights: I64) -> dict[str, list[float]]:
    """Return the ends of the interval of each figure over sequences.

    Args:
        sums: of the S sequences.
        weights: (B, S) how often each counts in a resample.
    """
    parts = tuple(s.hota for s in sums), tuple(s.identity for s in sums)
    metrics = hota_metrics(parts[0]) | identity_metrics(parts[1])
    return {name: list(s.interval()) for name, s in sampled(metrics, weights).items()}


def counted_pairs(files: Files, rules: KittiRules, threshold: float) -> Pairs:
    """Return the overlapping pairs of what counts."""
    kinds = (rules.kind, *DISTRACTORS[rules.kind])
    labels = files.labels
    truth = _by_frame(labels.select(np.isin(labels.kind, kinds) & (labels.id >= 0)))
    tracks = _by_frame(files.results.select(files.results.kind == rules.kind))
    tracks = tracks.select(_mean_scores(tracks) >= threshold)
    pairs = _pairs(truth, tracks, rules)
    distractor = (truth.kind != rules.kind) | (truth.occlusion > rules.max_occlusion)
    distractor |= truth.truncation > rules.max_truncation
    match = _match(pairs, rules)
    hit = match >= 0
    out = hit & distractor[match] if len(truth) else hit
    out |= ~hit & _unlabelled(labels, tracks, rules, ~hit)
    return _pairs(truth.select(~distractor), tracks.select(~out), rules)


def _by_frame(boxes: KittiBoxes) -> KittiBoxes:
    return boxes.select(np.argsort(boxes.frame, kind="stable"))


def _mean_scores(tracks: KittiBoxes) -> F64:
    """Return the mean score of each box's track, (P,)."""
    _, track = np.unique(tracks.id, return_inverse=True)
    means: F64 = (np.bincount(track, tracks.score) / np.maximum(np.bincount(track), 1))[track]
    return means


def _pairs(truth: KittiBoxes, tracks: KittiBoxes, rules: KittiRules) -> Pairs:
    frames = int(max(truth.frame.max(initial=-1), tracks.frame.max(initial=-1))) + 1
    first, second = (BoxStream(side.frame, side.id) for side in (truth, tracks))
    true, said = (_extended(side, rules) for side in (truth, tracks))
    iou = iou_3d if rules.measure == "3d" else rectangle_iou
    return find_pairs(first, second, frames, overlap(iou, true, said))


def _extended(boxes: KittiBoxes, rules: KittiRules) -> Extended:
    if rules.measure == "2d":
        return Extended(boxes.image_box, boxes.image_box[:, [0, 2]])
    reach_m = np.hypot(boxes.box[:, 3], boxes.box[:, 4]) / 2
    centre_m = boxes.box[:, 0]
    return Extended(boxes.box, np.column_stack([centre_m - reach_m, centre_m + reach_m]))


def _match(pairs: Pairs, rules: KittiRules) -> I64:
    """Return the true box that each track box matches, frame by frame, -1 for none, (P,)."""
    near = np.where(pairs.similarity >= rules.min_iou - _ROUNDING, pairs.similarity, 0.0)
    match = np.full(len(pairs.tracks), -1)
    for rows in pairs.by_frame(np.unique(pairs.frame)):
        dense = pairs.matrix(rows, near, 0.0)
        i, j = linear_sum_assignment(dense, maximize=True)
        good = dense[i, j] > _ROUNDING
        match[rows.tracks.start + j[good]] = rows.truth.start + i[good]
    return match


def _unlabelled(labels: KittiBoxes, tracks: KittiBoxes, rules: KittiRules, among: Mask) -> Mask:
    """Return which of some track boxes (P,) are too low or in a region without labels."""
    box = tracks.image_box
    out: Mask = box[:, 3] - box[:, 1] <= rules.min_height_px + _ROUNDING
    regions = labels.select(labels.kind == "dontcare")
    for row in np.flatnonzero(among & ~out):
        near = regions.image_box[regions.frame == tracks.frame[row]]
        own = box[row][None]
        least = rules.dont_care_share * rectangle_area(own)[:, None]
        out[row] = (shared_area(own, near) > least).any()
    return out
