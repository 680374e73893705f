"""One class: recall levels, their score thresholds, and the metrics at each of them."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64
from mottrack.eval.nuscenes import kernel
from mottrack.eval.nuscenes.assignment import make_solver
from mottrack.eval.nuscenes.boxes import BoxTable, Prepared
from mottrack.eval.nuscenes.kernel import (
    COUNT_NAMES,
    MATCH,
    Scenes,
    count_passes,
    find_candidates,
)
from mottrack.eval.nuscenes.rules import FRAME_SECONDS, LEVEL_METRICS, METRIC_WORST, Rules

Curves = dict[str, F64]
"""Metric name, "confidence" and "recall_hypo" to (levels,) values, the highest recall first."""


@dataclass(frozen=True, slots=True)
class Tally:
    """Counts of passes, summed over scenes: (T, COUNT_NAMES) integers and (T,) metres."""

    counts: I64
    distance_m: F64


def class_scenes(prepared: Prepared, label: int, rules: Rules) -> Scenes:
    """The boxes of one class laid out for passes, with all candidate pairs."""
    samples = prepared.samples
    truth = prepared.truth.select(prepared.truth.label == label)
    tracks = prepared.tracks.select(prepared.tracks.label == label)
    scene_of_object, object_of = _number_by_scene(truth, samples.scene_of_sample())
    edges = np.arange(len(samples) + 1)
    scenes = Scenes(
        scene=_records(
            kernel.SCENE,
            frame=samples.first,
            object=np.searchsorted(scene_of_object, np.arange(samples.scenes + 1)),
        ),
        frame=_records(
            kernel.FRAME,
            truth=np.searchsorted(truth.sample, edges),
            track=np.searchsorted(tracks.sample, edges),
        ),
        truth=_records(kernel.TRUTH, 1, **_xy(truth), object=object_of),
        track=_records(
            kernel.TRACK,
            1,
            **_xy(tracks),
            id=tracks.track + 1,
            score=tracks.score,
            same_before=_same_before(tracks),
        ),
        pair=np.zeros(0, kernel.PAIR),
        object=_records(kernel.OBJECT, length=np.bincount(object_of)),
    )
    pairs = find_candidates(scenes, rules.match_distance_m)
    scenes = scenes._replace(pair=np.zeros(pairs, kernel.PAIR))
    find_candidates(scenes, rules.match_distance_m)
    return scenes


def _records(kind: np.dtype[Any], spare: int = 0, **columns: NDArray[Any]) -> NDArray[Any]:
    """A table of records from columns, with rows to spare at its end."""
    table = np.zeros(len(next(iter(columns.values()))) + spare, kind)
    for name, column in columns.items():
        table[name][: len(column)] = column
    return table


def _xy(boxes: BoxTable) -> dict[str, F64]:
    return {"x": boxes.centre_m[:, 0], "y": boxes.centre_m[:, 1]}


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


def run_passes(scenes: Scenes, scene: I64, threshold: F64) -> Tally:
    """Passes over (scene, threshold) jobs (J,); events are left in `scenes.truth`."""
    counts = np.zeros((len(scene), len(COUNT_NAMES)), np.int64)
    distance = np.zeros(len(scene))
    largest = max(int(np.diff(scenes.frame[side]).max(initial=0)) for side in ("truth", "track"))
    count_passes(scenes, make_solver(largest), (scene, threshold), counts, distance)
    return Tally(counts, distance)


def run_at(scenes: Scenes, threshold: float) -> Tally:
    """One pass over every scene; the tally is per scene."""
    every = np.arange(len(scenes.scene) - 1)
    return run_passes(scenes, every, np.full(len(every), threshold))


def scene_of_tracks(scenes: Scenes) -> I64:
    """(P,) scene of each predicted box."""
    edges = scenes.frame["track"][scenes.scene["frame"]]
    return np.repeat(np.arange(len(edges) - 1), np.diff(edges))


def matched_scores(scenes: Scenes) -> tuple[F64, I64]:
    """Scores that set the recall levels, and the scene of each, from a pass without threshold.

    They are those of every box whose id was matched, without a switch, in the box's frame.
    """
    run_at(scenes, -np.inf)
    truth, track = scenes.truth[:-1], scenes.track[:-1]
    hit = np.zeros(len(track), np.bool_)
    hit[truth["match"][truth["event"] == MATCH]] = True
    if (track["same_before"] >= 0).any():
        frames = np.diff(scenes.frame["track"])
        frame = np.repeat(np.arange(len(frames)), frames)
        key = frame * (int(track["id"].max()) + 1) + track["id"]
        hit = np.isin(key, key[hit])
    return track["score"][hit], scene_of_tracks(scenes)[hit]


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
    boxes = len(scenes.truth) - 1
    if boxes == 0:
        return unreached_curves(rules)
    threshold, recall = thresholds(matched_scores(scenes)[0], boxes, rules)
    levels = np.unique(threshold[~np.isnan(threshold)])
    tally = tally_levels(scenes, levels)
    return curves_of(tally, (threshold, recall, levels), (boxes, len(scenes.object)))


def unreached_curves(rules: Rules) -> Curves:
    """The curves of a class without truth: nothing is defined."""
    names = (*LEVEL_METRICS, "confidence", "recall_hypo")
    return {name: np.full(rules.levels, np.nan) for name in names}


def tally_levels(scenes: Scenes, levels: F64) -> Tally:
    """Counts at each threshold, over all scenes.

    A scene in which no track lies between two thresholds is passed over once for both.
    """
    count = len(scenes.scene) - 1
    scene, rank = scene_ranks(scenes, levels)
    job = scene * len(scenes.track) + rank
    _, first, same = np.unique(job, return_index=True, return_inverse=True)
    tally = run_passes(scenes, scene[first], np.tile(levels, count)[first])
    shape = (count, len(levels))
    counts = tally.counts[same].reshape(*shape, len(COUNT_NAMES)).sum(axis=0)
    return Tally(counts, tally.distance_m[same].reshape(shape).sum(axis=0))


def scene_ranks(scenes: Scenes, levels: F64) -> tuple[I64, I64]:
    """For every scene and level (scenes * levels,): the scene, and its boxes below the level."""
    edges = scenes.frame["track"][scenes.scene["frame"]]
    score = scenes.track["score"]
    rank = [np.searchsorted(np.sort(score[a:b]), levels) for a, b in pairwise(edges)]
    return np.repeat(np.arange(len(rank)), len(levels)), np.concatenate(rank)


def curves_of(tally: Tally, grid: tuple[F64, F64, F64], truth: tuple[int, int]) -> Curves:
    """Metrics at every level from counts at every distinct threshold.

    `grid` holds the threshold and the recall of each level and the distinct thresholds of the
    tally, `truth` the number of true boxes and of true tracks.
    """
    threshold, recall, levels = grid
    reached = ~np.isnan(threshold)
    curves = {"confidence": threshold, "recall_hypo": recall}
    if not reached.any():
        return curves | {
            name: np.full(len(threshold), _worst(name, truth)) for name in LEVEL_METRICS
        }
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
    """The fifteen metrics from counts (T, COUNT_NAMES), (T,) each."""
    c = dict(zip(COUNT_NAMES, tally.counts.T.astype(np.float64), strict=True))
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
