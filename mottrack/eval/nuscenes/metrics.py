"""Metrics of each class at forty recall levels, and the official summary: AMOTA, AMOTP, totals."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64
from mottrack.eval.arithmetic import mota, ratio
from mottrack.eval.nuscenes import kernel
from mottrack.eval.nuscenes.assignment import make_solver
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Prepared
from mottrack.eval.nuscenes.kernel import (
    COUNT_NAMES,
    MATCH,
    Passes,
    Scenes,
    count_passes,
    find_candidates,
)
from mottrack.eval.nuscenes.levels import Levels, ScoreCounts, recall_levels
from mottrack.eval.nuscenes.prepare import prepare
from mottrack.eval.nuscenes.products import RECORDED, of_this_machine
from mottrack.eval.nuscenes.rules import (
    FRAME_SECONDS,
    LEVEL_METRICS,
    METRIC_WORST,
    SUMMARY_METRICS,
    SUMMED_METRICS,
    Rules,
)

AVERAGED = {"amota": "motar", "amotp": "motp"}
"""Metrics that are the mean over the levels of another."""
Curves = dict[str, F64]
"""Metric name, "confidence" and "recall_hypo" to (levels,) values, the highest recall first."""


class Tally(NamedTuple):
    """Counts of T passes."""

    counts: I64
    """(T, COUNT_NAMES)"""
    distance_m: F64
    """(T,) sum of the distances of all matches."""


class TruthSize(NamedTuple):
    """How much truth a class has."""

    boxes: int
    tracks: int


class MatchedScores(NamedTuple):
    """The scores that set the recall levels."""

    score: F64
    """(M,)"""
    scene: I64
    """(M,)"""


def class_scenes(prepared: Prepared, label: int, rules: Rules) -> Scenes:
    """Lay the boxes of one class out for passes, with all candidate pairs."""
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
    products = RECORDED if rules.arithmetic == "recorded" else of_this_machine()
    pairs = find_candidates(scenes, rules.match_distance_m, products)
    scenes = scenes._replace(pair=np.zeros(pairs, kernel.PAIR))
    find_candidates(scenes, rules.match_distance_m, products)
    return scenes


def _records(kind: np.dtype[Any], spare: int = 0, **columns: NDArray[Any]) -> NDArray[Any]:
    """Return a table of records from columns, with spare rows at its end."""
    table = np.zeros(len(next(iter(columns.values()))) + spare, kind)
    for name, column in columns.items():
        table[name][: len(column)] = column
    return table


def _xy(boxes: BoxTable) -> dict[str, F64]:
    return {"x": boxes.centre_m[:, 0], "y": boxes.centre_m[:, 1]}


def _number_by_scene(truth: BoxTable, scene_of_sample: I64) -> tuple[I64, I64]:
    """Return the scene of each true track, ascending, and the number of each box's track."""
    _, first, track = np.unique(truth.track, return_index=True, return_inverse=True)
    scene = scene_of_sample[truth.sample[first]]
    order = np.argsort(scene, kind="stable")
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    return scene[order], number[track]


def _same_before(tracks: BoxTable) -> I64:
    """Return the box before with the same track in the same sample (P,), -1 for none."""
    order = np.lexsort((tracks.track, tracks.sample))
    same = np.zeros(len(order), np.bool_)
    track, sample = tracks.track[order], tracks.sample[order]
    same[1:] = (track[1:] == track[:-1]) & (sample[1:] == sample[:-1])
    before = np.full(len(order), -1)
    before[order] = np.where(same, np.roll(order, 1), -1)
    return before


def run_passes(scenes: Scenes, scene: I64, threshold: F64) -> Tally:
    """Run passes over (scene, threshold) jobs (J,); events are left in `scenes.truth`."""
    counts = np.zeros((len(scene), len(COUNT_NAMES)), np.int64)
    tally = Tally(counts, np.zeros(len(scene)))
    largest = max(int(np.diff(scenes.frame[key]).max(initial=0)) for key in ("truth", "track"))
    count_passes(scenes, make_solver(largest), Passes(scene, threshold, *tally))
    return tally


def run_at(scenes: Scenes, threshold: float) -> Tally:
    """Run one pass over every scene; the tally is per scene."""
    every = np.arange(len(scenes.scene) - 1)
    return run_passes(scenes, every, np.full(len(every), threshold))


def scene_of_tracks(scenes: Scenes) -> I64:
    """Return the scene of each predicted box, (P,)."""
    edges = scenes.frame["track"][scenes.scene["frame"]]
    return np.repeat(np.arange(len(edges) - 1), np.diff(edges))


def matched_scores(scenes: Scenes) -> MatchedScores:
    """Return the scores that set the recall levels, from a pass without threshold.

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
    return MatchedScores(track["score"][hit], scene_of_tracks(scenes)[hit])


def class_curves(scenes: Scenes, rules: Rules) -> Curves:
    """Return every metric of a class at every recall level."""
    boxes = len(scenes.truth) - 1
    if boxes == 0:
        return unreached_curves(rules)
    levels = recall_levels(ScoreCounts.of(matched_scores(scenes).score), boxes, rules)
    tally = tally_levels(scenes, levels.distinct)
    return curves_of(tally, levels, TruthSize(boxes, len(scenes.object)))


def unreached_curves(rules: Rules) -> Curves:
    """Return the curves of a class without truth: nothing is defined."""
    names = (*LEVEL_METRICS, "confidence", "recall_hypo")
    return {name: np.full(rules.levels, np.nan) for name in names}


def tally_levels(scenes: Scenes, levels: F64) -> Tally:
    """Return the counts at each threshold (T,), over all scenes.

    Where no track of a scene lies between two thresholds, one pass over it counts for both.
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
    """Return for every scene and level (scenes * levels,) the scene, and its boxes below it."""
    edges = scenes.frame["track"][scenes.scene["frame"]]
    score = scenes.track["score"]
    rank = [np.searchsorted(np.sort(score[a:b]), levels) for a, b in pairwise(edges)]
    return np.repeat(np.arange(len(rank)), len(levels)), np.concatenate(rank)


def curves_of(tally: Tally, levels: Levels, truth: TruthSize) -> Curves:
    """Return the metrics at every level from the counts at every distinct threshold."""
    threshold, recall = levels
    reached = ~np.isnan(threshold)
    curves = {"confidence": threshold, "recall_hypo": recall}
    if not reached.any():
        return curves | {
            name: np.full(len(threshold), _worst(name, truth)) for name in LEVEL_METRICS
        }
    row = np.searchsorted(levels.distinct, threshold[reached])
    for name, values in level_metrics(tally, truth.boxes).items():
        curves[name] = np.full(len(threshold), np.nan)
        curves[name][reached] = values[row]
    return curves


def _worst(name: str, truth: TruthSize) -> float:
    if METRIC_WORST[name] != -1:
        return float(METRIC_WORST[name])
    if name == "ml":
        return truth.tracks
    return truth.boxes if name in ("gt", "fn") else float("nan")


def level_metrics(tally: Tally, truth_boxes: int) -> Curves:
    """Return the fifteen metrics, (T,) each."""
    c = dict(zip(COUNT_NAMES, tally.counts.T.astype(np.float64), strict=True))
    tp, ids, fn, fp = c["tp"], c["ids"], c["fn"], c["fp"]
    hits = tp + ids
    recall = tp / truth_boxes
    errors = fn + ids + fp
    den = recall * truth_boxes
    with np.errstate(divide="ignore", invalid="ignore"):
        motar = np.maximum(0.0, 1 - (errors - (1 - recall) * truth_boxes) / den)
        motar[den == 0] = np.nan
        return {
            "gt": np.full(len(tp), float(truth_boxes)),
            "tp": tp,
            "motar": motar,
            "mota": np.maximum(0.0, mota(errors, truth_boxes)),
            "motp": ratio(tally.distance_m, hits),
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


@dataclass(frozen=True, slots=True)
class Metrics:
    """The official metrics."""

    rules: Rules
    total: dict[str, float]
    """Metric name to value over all classes."""
    classes: dict[str, dict[str, float]]
    """Class to metric to value; NaN for a class without truth."""
    curves: dict[str, Curves]
    """Class to its metrics at every recall level."""

    def by_class(self) -> dict[str, dict[str, float]]:
        """Return the metrics of every class, then those of "all"."""
        return {**self.classes, "all": self.total}


def evaluate(truth: GroundTruth, predictions: BoxTable, rules: Rules | None = None) -> Metrics:
    """Return the official tracking metrics of predictions.

    Raises:
        InputError: no true or no predicted box is left to evaluate.
    """
    rules = rules or Rules()
    return evaluate_prepared(prepare(truth, predictions, rules), rules)


def evaluate_prepared(prepared: Prepared, rules: Rules) -> Metrics:
    """Return the metrics of boxes that are filtered and interpolated already."""
    curves = {
        name: class_curves(class_scenes(prepared, label, rules), rules)
        for label, name in enumerate(rules.classes)
    }
    return summarise(curves, rules)


def summarise(curves: dict[str, Curves], rules: Rules) -> Metrics:
    """Return the metrics of each class and in total from its curves."""
    classes = {name: class_summary(curve) for name, curve in curves.items()}
    return Metrics(rules, total_of(list(classes.values())), classes, curves)


def class_summary(curves: Curves) -> dict[str, float]:
    """Return the metrics of a class: averages over the levels, the rest at the best MOTA.

    Of equal MOTA the highest recall counts. Levels not reached count as worst in the averages.
    """
    if np.isnan(curves["mota"]).all():
        return dict.fromkeys(SUMMARY_METRICS, float("nan"))
    best = int(np.nanargmax(curves["mota"]))
    metrics = {name: float(curves[name][best]) for name in LEVEL_METRICS}
    for name, source in AVERAGED.items():
        values = curves[source]
        filled = np.where(np.isnan(values), METRIC_WORST[name], values)
        metrics[name] = float("nan") if np.isnan(values).all() else float(np.mean(filled))
    return {name: metrics[name] for name in SUMMARY_METRICS}


def total_of(classes: list[dict[str, float]]) -> dict[str, float]:
    """Sum the counts, average all else over the classes that have a value."""
    total = {}
    for name in SUMMARY_METRICS:
        values = np.array([metrics[name] for metrics in classes])
        known = values[~np.isnan(values)]
        if name in SUMMED_METRICS:
            total[name] = float(known.sum())
        else:
            total[name] = float(known.mean()) if len(known) else float("nan")
    return total
