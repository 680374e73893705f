"""One class: recall levels, their score thresholds, and the metrics at each of them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mottrack.eval.nuscenes.boxes import BoxTable, Prepared
from mottrack.eval.nuscenes.kernel import (
    COUNTS, FN, FP, FRAG, FRAMES, GAP, IDS, MATCH, ML, MT, TP, TRACKED, WAIT,
    Scenes, candidate_pairs, count_passes, make_work,
)  # fmt: skip
from mottrack.eval.nuscenes.rules import FRAME_SECONDS, LEVEL_METRICS, METRIC_WORST, Rules

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Curves = dict[str, F64]
"""Metric name, "confidence" and "recall_hypo" to (levels,) values, the highest recall first."""


@dataclass(frozen=True, slots=True)
class Tally:
    """Counts of passes, summed over scenes: (T, COUNTS) integers and (T,) metres."""

    counts: I64
    distance_m: F64


@dataclass(frozen=True, slots=True)
class Events:
    """What became of every true box in one pass."""

    kind: I64
    """(G,) MISS, MATCH or SWITCH."""
    track_row: I64
    """(G,) row of the matched predicted box, -1 for none."""


def class_scenes(prepared: Prepared, label: int, rules: Rules) -> Scenes:
    """The boxes of one class laid out for passes, with all candidate pairs."""
    samples = prepared.samples
    truth = prepared.truth.select(prepared.truth.label == label)
    tracks = prepared.tracks.select(prepared.tracks.label == label)
    edges = np.arange(len(samples) + 1)
    truth_edges, track_edges = (np.searchsorted(t.sample, edges) for t in (truth, tracks))
    objects, object_of = _number_by_scene(truth, samples.scene_of_sample())
    pairs = _pairs((truth_edges, track_edges), truth, tracks, rules.match_distance_m)
    return Scenes(
        samples.first,
        truth_edges,
        track_edges,
        np.searchsorted(objects, np.arange(samples.scenes + 1)),
        object_of,
        np.bincount(object_of),
        tracks.track,
        _same_before(tracks),
        tracks.score,
        *pairs,
    )


def _number_by_scene(truth: BoxTable, scene_of_sample: I64) -> tuple[I64, I64]:
    """Scene of each true track, ascending, and the number of each box's track."""
    _, first, track = np.unique(truth.track, return_index=True, return_inverse=True)
    scene = scene_of_sample[truth.sample[first]]
    order = np.argsort(scene, kind="stable")
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    return scene[order], number[track]


def _same_before(tracks: BoxTable) -> I64:
    """(P,) the box before with the same track in the same sample, -1 for none."""
    order = np.lexsort((tracks.track, tracks.sample))
    same = np.zeros(len(order), np.bool_)
    track, sample = tracks.track[order], tracks.sample[order]
    same[1:] = (track[1:] == track[:-1]) & (sample[1:] == sample[:-1])
    before = np.full(len(order), -1)
    before[order] = np.where(same, np.roll(order, 1), -1)
    return before


def _pairs(
    edges: tuple[I64, I64], truth: BoxTable, tracks: BoxTable, gate: float
) -> tuple[I64, I64, F64]:
    truth_xy = np.ascontiguousarray(truth.centre_m[:, :2])
    track_xy = np.ascontiguousarray(tracks.centre_m[:, :2])
    pair_edges = np.zeros(len(truth) + 1, np.int64)
    room = 0
    while True:
        out = (pair_edges, np.empty(room, np.int64), np.empty((room, 2)))
        count = candidate_pairs(edges, truth_xy, track_xy, gate, out)
        if count <= room:
            return out
        room = count


def run_passes(scenes: Scenes, scene: I64, threshold: F64) -> tuple[Tally, Events]:
    """Passes over (scene, threshold) jobs (J,), their counts, and the last events."""
    counts = np.zeros((len(scene), COUNTS), np.int64)
    distance = np.zeros(len(scene))
    event = np.zeros((2, len(scenes.truth_object)), np.int64)
    count_passes(scenes, make_work(scenes), (scene, threshold), counts, distance, event)
    return Tally(counts, distance), Events(event[0], event[1])


def run_at(scenes: Scenes, threshold: float) -> tuple[Tally, Events]:
    """One pass over every scene; the tally is per scene."""
    every = np.arange(len(scenes.frame_edges) - 1)
    return run_passes(scenes, every, np.full(len(every), threshold))


def matched_scores(scenes: Scenes) -> tuple[F64, I64]:
    """Scores that set the recall levels, and the scene of each, from a pass without threshold.

    They are those of every box whose id was matched, without a switch, in the box's frame.
    """
    _, events = run_at(scenes, -np.inf)
    frame = np.repeat(np.arange(len(scenes.track_edges) - 1), np.diff(scenes.track_edges))
    scene = np.searchsorted(scenes.frame_edges, frame, "right") - 1
    hit = np.zeros(len(scenes.score), np.bool_)
    hit[events.track_row[events.kind == MATCH]] = True
    if (scenes.same_before >= 0).any():
        key = frame * (int(scenes.track_id.max()) + 1) + scenes.track_id
        hit = np.isin(key, key[hit])
    return scenes.score[hit], scene[hit]


def thresholds(scores: F64, truth_boxes: int, rules: Rules) -> tuple[F64, F64]:
    """Score thresholds (levels,) and their recall, the highest recall first; NaN: not reached."""
    recall = np.linspace(rules.min_recall, 1, rules.levels).round(12)
    if not len(scores):
        nothing = np.full(rules.levels, np.nan)
        return nothing, nothing
    descending = np.sort(scores)[::-1]
    reached = np.arange(1, len(scores) + 1) / truth_boxes
    threshold = np.interp(recall, reached, descending, right=0)
    threshold[recall > reached.max()] = np.nan
    return threshold[::-1], recall[::-1]


def class_curves(scenes: Scenes, rules: Rules) -> Curves:
    """Every metric of a class at every recall level."""
    boxes = len(scenes.truth_object)
    if boxes == 0:
        names = (*LEVEL_METRICS, "confidence", "recall_hypo")
        return {name: np.full(rules.levels, np.nan) for name in names}
    threshold, recall = thresholds(matched_scores(scenes)[0], boxes, rules)
    levels = np.unique(threshold[~np.isnan(threshold)])
    tally = tally_levels(scenes, levels)
    return curves_of(tally, (threshold, recall, levels), (boxes, len(scenes.length)))


def tally_levels(scenes: Scenes, levels: F64) -> Tally:
    """Counts at each threshold, over all scenes.

    A scene in which no track lies between two thresholds is passed over once for both.
    """
    count = len(scenes.frame_edges) - 1
    scene, rank = scene_ranks(scenes, levels)
    job = scene * (len(scenes.score) + 1) + rank
    _, first, same = np.unique(job, return_index=True, return_inverse=True)
    tally, _ = run_passes(scenes, scene[first], np.tile(levels, count)[first])
    shape = (count, len(levels))
    counts = tally.counts[same].reshape(*shape, COUNTS).sum(axis=0)
    return Tally(counts, tally.distance_m[same].reshape(shape).sum(axis=0))


def scene_ranks(scenes: Scenes, levels: F64) -> tuple[I64, I64]:
    """For every scene and level (scenes * levels,): the scene, and its boxes below the level."""
    count = len(scenes.frame_edges) - 1
    edges = scenes.track_edges[scenes.frame_edges]
    rank = [np.searchsorted(np.sort(scenes.score[a:b]), levels) for a, b in pairwise(edges)]
    return np.repeat(np.arange(count), len(levels)), np.concatenate(rank)


def curves_of(
    tally: Tally, grid: tuple[F64, F64, F64], truth: tuple[int, int]
) -> Curves:
    """Metrics at every level from counts at every distinct threshold.

    `grid` holds the threshold and the recall of each level and the distinct thresholds of the
    tally, `truth` the number of true boxes and of true tracks.
    """
    threshold, recall, levels = grid
    reached = ~np.isnan(threshold)
    curves = {"confidence": threshold, "recall_hypo": recall}
    if not reached.any():
        return curves | {name: np.full(len(threshold), _worst(name, truth)) for name in LEVEL_METRICS}
    row = np.searchsorted(levels, threshold[reached])
    for name, values in level_metrics(tally, truth[0]).items():
        curves[name] = np.full(len(threshold), np.nan)
        curves[name][reached] = values[row]
    return curves


def _worst(name: str, truth: tuple[int, int]) -> float:
    if METRIC_WORST[name] != -1:
        return float(METRIC_WORST[name])
    if name == "ml":
        return truth[1]
    return truth[0] if name in ("gt", "fn") else float("nan")


def level_metrics(tally: Tally, truth_boxes: int) -> Curves:
    """The fifteen metrics from counts (T, COUNTS), (T,) each."""
    c = {name: tally.counts[:, i].astype(np.float64) for name, i in _COLUMNS.items()}
    tp, ids, fn, fp = c["tp"], c["ids"], c["fn"], c["fp"]
    hits = tp + ids
    recall = tp / truth_boxes
    gone = fn + ids + fp
    den = recall * truth_boxes
    with np.errstate(divide="ignore", invalid="ignore"):
        motar = np.maximum(0.0, 1 - (gone - (1 - recall) * truth_boxes) / den)
        motar[den == 0] = np.nan
        return {
            "gt": np.full(len(tp), float(truth_boxes)),
            "tp": tp,
            "motar": motar,
            "mota": np.maximum(0.0, 1.0 - gone / truth_boxes),
            "motp": np.where(hits > 0, tally.distance_m / hits, np.nan),
            "faf": fp / c["frames"] * 100,
            "mt": c["mt"],
            "ml": c["ml"],
            "fp": fp,
            "fn": fn,
            "ids": ids,
            "frag": c["frag"],
            "recall": hits / truth_boxes,
            "tid": c["wait"] * FRAME_SECONDS / c["tracked"],
            "lgd": c["gap"] * FRAME_SECONDS / c["tracked"],
        }


_COLUMNS = {
    "tp": TP, "ids": IDS, "fn": FN, "fp": FP, "frames": FRAMES, "frag": FRAG, "mt": MT, "ml": ML,
    "tracked": TRACKED, "wait": WAIT, "gap": GAP,
}  # fmt: skip
