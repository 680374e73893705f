"""The official metrics on resamples of the scenes.

AMOTA does not add up over scenes: its thresholds depend on all of them. A scene's counts change
only where the threshold passes one of its own scores. So the passes at all of a scene's distinct
scores give its counts at every threshold, and the counts of a resample are weighted sums of rows,
whatever thresholds it has. Counts are exact, other metrics equal to the rounding of sums (1e-9).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I32, I64, Mask
from mottrack.eval.nuscenes.boxes import Prepared
from mottrack.eval.nuscenes.kernel import Scenes
from mottrack.eval.nuscenes.levels import ScoreCounts, recall_levels
from mottrack.eval.nuscenes.metrics import (
    Curves,
    Metrics,
    Tally,
    TruthSize,
    class_scenes,
    curves_of,
    matched_scores,
    run_passes,
    summarise,
    unreached_curves,
)
from mottrack.eval.nuscenes.rules import SUMMARY_METRICS, Rules
from mottrack.eval.paired import MetricKey, PairedDifference, Sampled, paired

LOWER_IS_BETTER = frozenset({"amotp", "motp", "ml", "faf", "fp", "fn", "ids", "frag", "tid", "lgd"})
SampledMetrics = dict[str, dict[str, Sampled]]
"""Class, or "all", to metric to its value on the whole and on every resample."""


@dataclass(frozen=True, slots=True)
class Profile:
    """One class of S scenes: what its figures are made of, without a box.

    A pass over a scene at a threshold gives the counts of the scene's next higher score: R rows,
    one for each score of each scene, and one without any track.
    """

    truth_boxes: I64
    """(S,)"""
    truth_tracks: I64
    """(S,)"""
    track_boxes: I64
    """(S,)"""
    matched: ScoreCounts
    """The scores that set the recall levels."""
    matched_scene: I32
    """(M,) scene of each of them."""
    first: I64
    """(S + 1,) first row of each scene, and the end."""
    own: F64
    """(R,) the distinct scores of a scene, ascending, then infinity."""
    counts: I32
    """(R, COUNT_NAMES) of a pass."""
    distance_m: F64
    """(R,) sum of the distances of all matches of a pass."""

    @property
    def present(self) -> Mask:
        """(S,) scenes with a true or a predicted box of the class."""
        return self.truth_boxes + self.track_boxes > 0

    @classmethod
    def joined(cls, parts: Sequence[Profile]) -> Profile:
        """Return the profile of the scenes of all parts, at least one, in order."""

        def column(name: str) -> Any:
            return np.concatenate([getattr(part, name) for part in parts])

        scenes = np.cumsum([0, *(len(part.truth_boxes) for part in parts)])
        rows = np.cumsum([0, *(len(part.own) for part in parts)])
        score, boxes = (np.concatenate(c) for c in zip(*(p.matched for p in parts), strict=True))
        scene = np.concatenate([p.matched_scene + s for p, s in zip(parts, scenes, strict=False)])
        order = np.argsort(-score, kind="stable")
        first = [p.first[:-1] + r for p, r in zip(parts, rows, strict=False)]
        return cls(
            **{name: column(name) for name in ("truth_boxes", "truth_tracks", "track_boxes")},
            matched=ScoreCounts(score[order], boxes[order]),
            matched_scene=scene[order].astype(np.int32),
            first=np.concatenate([*first, rows[-1:]]),
            **{name: column(name) for name in ("own", "counts", "distance_m")},
        )

    def at(self, threshold: F64, weight: I64) -> Tally:
        """Return the sums over all scenes, scene s `weight[s]` times, at each threshold (L,)."""
        rows = rows_at(self.first, self.own, threshold)
        present = np.flatnonzero(weight)
        # in memory one threshold after the other, so that BLAS adds up the scenes of each alone
        columns = np.asfortranarray(self.distance_m[rows[present]])
        distance_m = weight[present].astype(np.float64) @ columns
        return Tally(weighted_counts(self.counts, rows, weight), distance_m)

    def at_once(self, threshold: F64) -> Tally:
        """Return the sums over all scenes at each threshold, added up scene by scene."""
        rows = rows_at(self.first, self.own, threshold)
        once = np.ones(len(rows), np.int64)
        return Tally(weighted_counts(self.counts, rows, once), self.distance_m[rows].sum(axis=0))


@compiled
def rows_at(first: I64, own: F64, threshold: F64) -> I64:
    """Return the row of each scene at each threshold, (S, L), of ascending thresholds (L,)."""
    rows = np.empty((len(first) - 1, len(threshold)), np.int64)
    for scene in range(len(rows)):
        row = first[scene]
        for level in range(len(threshold)):
            while own[row] < threshold[level]:
                row += 1
            rows[scene, level] = row
    return rows


@compiled
def weighted_counts(counts: I32, rows: I64, weight: I64) -> I64:
    """Return the sum of the counts of rows (S, L), those of scene s `weight[s]` times, (L, C)."""
    sums = np.zeros((rows.shape[1], counts.shape[1]), np.int64)
    for scene in range(len(rows)):
        if weight[scene] > 0:
            for level in range(rows.shape[1]):
                for kind in range(counts.shape[1]):
                    sums[level, kind] += weight[scene] * counts[rows[scene, level], kind]
    return sums


def make_profile(scenes: Scenes) -> Profile:
    """Return the profile of a class."""
    score, scene = matched_scores(scenes)
    pairs, boxes = np.unique(np.stack([-score, scene]), axis=1, return_counts=True)
    truth = scenes.frame["truth"][scenes.scene["frame"]]
    edges = scenes.frame["track"][scenes.scene["frame"]]
    own = [np.r_[np.unique(scenes.track["score"][a:b]), np.inf] for a, b in pairwise(edges)]
    sizes = [len(scores) for scores in own]
    thresholds = np.concatenate(own)
    tally = run_passes(scenes, np.repeat(np.arange(len(own)), sizes), thresholds)
    return Profile(
        truth_boxes=np.diff(truth),
        truth_tracks=np.diff(scenes.scene["object"]),
        track_boxes=np.diff(edges),
        matched=ScoreCounts(-pairs[0], boxes),
        matched_scene=pairs[1].astype(np.int32),
        first=np.cumsum([0, *sizes]),
        own=thresholds,
        counts=tally.counts.astype(np.int32),
        distance_m=tally.distance_m,
    )


def weighted_curves(profile: Profile, weight: I64, rules: Rules) -> Curves:
    """Return the curves of a class when scene s counts `weight[s]` times (S,)."""
    truth = TruthSize(int(weight @ profile.truth_boxes), int(weight @ profile.truth_tracks))
    if truth.boxes == 0:
        return unreached_curves(rules)
    matched = profile.matched._replace(boxes=profile.matched.boxes * weight[profile.matched_scene])
    levels = recall_levels(matched, truth.boxes, rules)
    return curves_of(profile.at(levels.distinct, weight), levels, truth)


def whole_curves(profile: Profile, rules: Rules) -> Curves:
    """Return the curves of a class, each scene once: those of `metrics.class_curves`."""
    truth = TruthSize(int(profile.truth_boxes.sum()), int(profile.truth_tracks.sum()))
    if truth.boxes == 0:
        return unreached_curves(rules)
    levels = recall_levels(profile.matched, truth.boxes, rules)
    return curves_of(profile.at_once(levels.distinct), levels, truth)


def profiles(prepared: Prepared, rules: Rules) -> list[Profile]:
    """Return the profile of every class of the rules."""
    return [make_profile(class_scenes(prepared, k, rules)) for k in range(len(rules.classes))]


def evaluate_profiles(classes: Sequence[Profile], rules: Rules) -> Metrics:
    """Return the metrics that `metrics.evaluate_prepared` has for the boxes of the profiles."""
    curves = {
        name: whole_curves(profile, rules)
        for name, profile in zip(rules.classes, classes, strict=True)
    }
    return summarise(curves, rules)


def evaluate_weighted(classes: Sequence[Profile], weight: I64, rules: Rules) -> Metrics:
    """Return the metrics when scene s counts `weight[s]` times."""
    curves = {
        name: weighted_curves(profile, weight, rules)
        for name, profile in zip(rules.classes, classes, strict=True)
    }
    return summarise(curves, rules)


def sampled_metrics(classes: Sequence[Profile], weights: I64, rules: Rules) -> SampledMetrics:
    """Evaluate every metric, per class and in total, on the whole and on resamples (B, S)."""
    once = np.ones((1, weights.shape[1]), np.int64)
    rows = [evaluate_weighted(classes, w, rules).by_class() for w in np.vstack([once, weights])]
    present = {name: p.present for name, p in zip(rules.classes, classes, strict=True)}
    every = np.ones(weights.shape[1], np.bool_)
    out: SampledMetrics = {}
    for label in rows[0]:
        columns = {name: np.array([row[label][name] for row in rows]) for name in SUMMARY_METRICS}
        scenes = present.get(label, every)
        out[label] = {n: Sampled(float(c[0]), c[1:], scenes) for n, c in columns.items()}
    return out


def differences(baseline: SampledMetrics, run: SampledMetrics) -> Iterator[PairedDifference]:
    """Yield the paired difference of every metric, both sampled with the same weights."""
    for label, metrics in baseline.items():
        for name, side in metrics.items():
            key = MetricKey("tracking", label, name, lower_is_better=name in LOWER_IS_BETTER)
            yield paired(key, side, run[label][name])
