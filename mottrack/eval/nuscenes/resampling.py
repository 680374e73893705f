"""The official metrics on resamples of the scenes.

AMOTA does not add up over scenes: its thresholds depend on all of them. A scene's counts change
only where the threshold passes one of its own scores. So the passes at all of a scene's distinct
scores give its counts at every threshold, and the counts of a resample are weighted sums of rows,
whatever thresholds it has. Counts are exact, other metrics equal to the rounding of sums (1e-9).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mottrack.core.arrays import F64, I32, I64, Mask
from mottrack.eval.nuscenes.boxes import Prepared
from mottrack.eval.nuscenes.kernel import Scenes
from mottrack.eval.nuscenes.metrics import (
    Curves,
    Metrics,
    Tally,
    TruthSize,
    class_scenes,
    curves_of,
    matched_scores,
    recall_levels,
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
    """One class of S scenes."""

    truth_boxes: I64
    """(S,)"""
    truth_tracks: I64
    """(S,)"""
    track_boxes: I64
    """(S,)"""
    matched_score: F64
    """(M,) the scores that set the recall levels, the highest first."""
    matched_scene: I64
    """(M,) scene of each of them."""
    distinct: F64
    """(U,) all distinct scores, ascending."""
    row: I32
    """(S, U + 1) row of `tally` for a scene when U' of the distinct scores are too low."""
    tally: Tally
    """Counts of every scene at each of its own scores."""

    @property
    def present(self) -> Mask:
        """(S,) scenes with a true or a predicted box of the class."""
        return self.truth_boxes + self.track_boxes > 0


def make_profile(scenes: Scenes) -> Profile:
    """Return the counters of a class."""
    score, scene = matched_scores(scenes)
    order = np.argsort(-score, kind="stable")
    boxes = scenes.frame["truth"][scenes.scene["frame"]]
    edges = scenes.frame["track"][scenes.scene["frame"]]
    own = [np.unique(scenes.track["score"][a:b]) for a, b in pairwise(edges)]
    distinct = np.unique(np.concatenate(own))
    first = np.cumsum([0, *(len(scores) + 1 for scores in own)])
    rank = [np.searchsorted(scores, np.r_[distinct, np.inf]) for scores in own]
    jobs = [np.r_[scores, np.inf] for scores in own]
    job_scene = np.repeat(np.arange(len(own)), [len(job) for job in jobs])
    return Profile(
        truth_boxes=np.diff(boxes),
        truth_tracks=np.diff(scenes.scene["object"]),
        track_boxes=np.diff(edges),
        matched_score=score[order],
        matched_scene=scene[order],
        distinct=distinct,
        row=(np.array(rank) + first[:-1, None]).astype(np.int32),
        tally=run_passes(scenes, job_scene, np.concatenate(jobs)),
    )


def weighted_curves(profile: Profile, weight: I64, rules: Rules) -> Curves:
    """Return the curves of a class when scene s counts `weight[s]` times (S,)."""
    truth = TruthSize(int(weight @ profile.truth_boxes), int(weight @ profile.truth_tracks))
    if truth.boxes == 0:
        return unreached_curves(rules)
    scores = np.repeat(profile.matched_score, weight[profile.matched_scene])
    levels = recall_levels(scores, truth.boxes, rules)
    present = np.flatnonzero(weight)
    rows = profile.row[present][:, np.searchsorted(profile.distinct, levels.distinct)]
    counts = np.einsum("s,slc->lc", weight[present], profile.tally.counts[rows])
    distance = weight[present].astype(np.float64) @ profile.tally.distance_m[rows]
    return curves_of(Tally(counts, distance), levels, truth)


def profiles(prepared: Prepared, rules: Rules) -> list[Profile]:
    """Return the counters of every class of the rules."""
    return [make_profile(class_scenes(prepared, k, rules)) for k in range(len(rules.classes))]


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
