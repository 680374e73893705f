"""A class reduced to counters per scene, from which any resample of scenes is evaluated exactly.

A scene's counts change only where the threshold passes one of its own scores. So the passes at all
of a scene's distinct scores tell its counts at every threshold, and the counts of a resample are
weighted sums of rows, whatever thresholds it has.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mottrack.core.arrays import F64, I32, I64
from mottrack.eval.nuscenes.kernel import Scenes
from mottrack.eval.nuscenes.levels import (
    Curves,
    Tally,
    curves_of,
    matched_scores,
    run_passes,
    thresholds,
    unreached_curves,
)
from mottrack.eval.nuscenes.rules import Rules


@dataclass(frozen=True, slots=True)
class Profile:
    """One class of S scenes."""

    truth_boxes: I64
    """(S,)"""
    truth_tracks: I64
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


def make_profile(scenes: Scenes) -> Profile:
    """The counters of a class."""
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
        matched_score=score[order],
        matched_scene=scene[order],
        distinct=distinct,
        row=(np.array(rank) + first[:-1, None]).astype(np.int32),
        tally=run_passes(scenes, job_scene, np.concatenate(jobs)),
    )


def weighted_curves(profile: Profile, weight: I64, rules: Rules) -> Curves:
    """The curves of a class when scene s counts `weight[s]` times (S,)."""
    boxes, tracks = int(weight @ profile.truth_boxes), int(weight @ profile.truth_tracks)
    if boxes == 0:
        return unreached_curves(rules)
    scores = np.repeat(profile.matched_score, weight[profile.matched_scene])
    threshold, recall = thresholds(scores, boxes, rules)
    levels = np.unique(threshold[~np.isnan(threshold)])
    present = np.flatnonzero(weight)
    rows = profile.row[present][:, np.searchsorted(profile.distinct, levels)]
    counts = np.einsum("s,slc->lc", weight[present], profile.tally.counts[rows])
    distance = weight[present].astype(np.float64) @ profile.tally.distance_m[rows]
    return curves_of(Tally(counts, distance), (threshold, recall, levels), (boxes, tracks))
