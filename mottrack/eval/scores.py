"""The scores of a run: everything that a table about stored scene results prints.

Boxes are matched by the distance of their centres over the ground, or by 3-D IoU, class by class.
CLEAR, IDF1 and HOTA come from one search for candidate pairs per scene and class; AMOTA and AMOTP
have rules of their own, and always go by distance.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core import InputError, SceneResult
from mottrack.core.arrays import F64, Mask
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval import clear, hota, identity
from mottrack.eval.flow_error import FlowError, flow_table
from mottrack.eval.memo import Memo
from mottrack.eval.nuscenes.from_results import prepare_results, rules_for
from mottrack.eval.nuscenes.levels import Curves
from mottrack.eval.nuscenes.summary import evaluate_prepared
from mottrack.eval.pairs import BoxStream, Pairs, centre_distance, find_pairs, overlap
from mottrack.eval.velocity_error import (
    ErrorRow,
    VelocityErrorConfig,
    velocity_samples,
    velocity_table,
)
from mottrack.formats.strict_json import strict
from mottrack.geometry.iou import boxes7, iou_3d

ROUNDING = 1e-9  # a threshold is the mean score of some track, added up in another order
BoxTable = TypeVar("BoxTable", TruthTable, TrackTable)


class ScoreConfig(StrictModel):
    """How boxes are matched."""

    match_by: Literal["distance", "iou"] = "distance"
    match_distance_m: float = Field(default=2.0, gt=0, description="centres nearer than this match")
    match_iou: float = Field(default=0.25, gt=0, le=1, description="3-D IoU from which boxes match")
    class_agnostic: bool = Field(default=False, description="match boxes of any class (clusters)")
    min_score: float | None = Field(
        default=None,
        description="tracks of a lower mean score are left out; null: per class what gives the "
        "best MOTA, as the official evaluation reports it",
    )
    velocity: VelocityErrorConfig = VelocityErrorConfig()

    @property
    def gate(self) -> float:
        """Pairs whose distance (metres, or 1 - IoU) is below this may match."""
        if self.match_by == "iou":
            return float(np.nextafter(1.0 - self.match_iou, 2.0))
        return self.match_distance_m


@dataclass(frozen=True, slots=True)
class ClassScores:
    """Figures of one class, or of all classes together."""

    clear: clear.ClearCounts
    identity: identity.IdentityCounts
    hota: hota.HotaCounts
    amota: float = float("nan")
    """Official AMOTA; NaN where classes are not told apart."""
    amotp_m: float = float("nan")
    """Official AMOTP, metres."""

    def as_dict(self) -> dict[str, float]:
        """The figures with their unit in the name.

        MOTP is a mean distance in metres, or 1 - IoU where boxes are matched by IoU.
        """
        counts = self.clear
        return {
            "amota": self.amota,
            "amotp_m": self.amotp_m,
            "mota": counts.mota,
            "motp_m": counts.motp,
            "recall": counts.recall,
            "precision": counts.precision,
            "matches": counts.matches,
            "misses": counts.misses,
            "false_positives": counts.false_positives,
            "id_switches": counts.switches,
            "fragmentations": counts.fragmentations,
            "mostly_tracked": counts.mostly_tracked,
            "mostly_lost": counts.mostly_lost,
            "truth_boxes": counts.truth,
            "truth_tracks": counts.truth_tracks,
            "idf1": self.identity.idf1,
            **hota.hota(self.hota).as_dict(),
        }


@dataclass(frozen=True, slots=True)
class Scores:
    """Every figure of a run."""

    overall: ClassScores
    classes: dict[str, ClassScores]
    velocity: dict[str, ErrorRow]
    """Row name to velocity error (velocity_error.velocity_table)."""
    flow: dict[str, FlowError]
    """Row name to flow error (flow_error.flow_table); empty where no flow was sampled."""

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for scores.json; a figure that does not exist is None."""
        figures = {
            "overall": self.overall.as_dict(),
            "classes": {name: scores.as_dict() for name, scores in self.classes.items()},
            "velocity_error": {name: asdict(row) for name, row in self.velocity.items()},
            "flow_error": {name: asdict(row) for name, row in self.flow.items()},
        }
        plain: dict[str, Any] = strict(figures)
        return plain


@dataclass(frozen=True, slots=True)
class ScoreFilter:
    """Which boxes of one class count."""

    label: str
    """The class; empty: every class."""
    threshold: float = -np.inf
    """Least mean score of a track."""
    range_m: float = np.inf
    """Boxes at least this far from the vehicle are left out, as the official rules do."""


def score(
    results: Sequence[SceneResult], config: ScoreConfig | None = None, memo: Memo | None = None
) -> Scores:
    """Scores of the scenes together.

    Truth counts from the first to the last frame in which its object has a LiDAR return. Where no
    track carries a class of the truth (clusters), classes are not told apart.
    """
    config, memo = config or ScoreConfig(), memo or Memo()
    results = [memo(SceneResult.where_labelled, result) for result in results]
    labels = counted_labels(results)
    class_aware = any(np.isin(r.tracks.label, np.unique(r.truth.label)).any() for r in results)
    if config.class_agnostic or not class_aware:
        return _scores(results, _class_scores(results, ScoreFilter(""), config), {}, config, memo)
    rules = rules_for(labels)
    try:
        figures = memo(evaluate_prepared, memo(prepare_results, results, rules), rules)
    except InputError:  # nothing in range on one side: counts are all there is to say
        return _scores(results, _class_scores(results, ScoreFilter(""), config), {}, config, memo)
    classes = {}
    for label, range_m in zip(rules.classes, rules.ranges_m, strict=True):
        cut = ScoreFilter(label, best_threshold(figures.curves[label], config), range_m)
        counted = _class_scores(results, cut, config)
        official = figures.classes[label]
        classes[label] = replace(counted, amota=official["amota"], amotp_m=official["amotp"])
    total = replace(
        _together(classes.values()),
        amota=figures.total["amota"],
        amotp_m=figures.total["amotp"],
    )
    return _scores(results, total, classes, config, memo)


def _scores(
    results: Sequence[SceneResult],
    overall: ClassScores,
    classes: dict[str, ClassScores],
    config: ScoreConfig,
    memo: Memo,
) -> Scores:
    flow = [result.flow for result in results if len(result.flow)]
    samples = [memo(velocity_samples, result, config.velocity) for result in results]
    declared = {name for result in results for name in result.classes}
    velocity = velocity_table(samples, config.velocity, declared)
    return Scores(overall, classes, velocity, flow_table(flow) if flow else {})


def counted_labels(results: Iterable[SceneResult]) -> list[str]:
    """The classes that count: those of the data set, else those in truth or tracks; in order."""
    listed = list(results)
    declared = {name for result in listed for name in result.classes}
    found = {str(n) for r in listed for t in (r.truth, r.tracks) for n in np.unique(t.label)}
    return sorted(declared & found if declared else found)


def best_threshold(curves: Curves, config: ScoreConfig) -> float:
    """The given least score, or that of the level with the best MOTA."""
    if config.min_score is not None:
        return config.min_score
    if np.isnan(curves["mota"]).all() or np.isnan(curves["confidence"]).all():
        return np.inf  # nothing of this class is ever matched: no track at all scores best
    reached = np.where(np.isnan(curves["confidence"]), -np.inf, curves["mota"])
    return float(curves["confidence"][int(np.nanargmax(reached))])


def _class_scores(
    results: Iterable[SceneResult], cut: ScoreFilter, config: ScoreConfig
) -> ClassScores:
    return _together(scene_scores(result, cut, config) for result in results)


def scene_pairs(result: SceneResult, cut: ScoreFilter, config: ScoreConfig) -> Pairs:
    """Candidate pairs of a scene for one class; every class where the label is empty."""
    truth = _rows(result.truth.select(_seen(result.truth)), cut.label)
    tracks = _rows(result.tracks, cut.label)
    truth = truth.select(_near(result, truth, cut.range_m))
    tracks = tracks.select(_near(result, tracks, cut.range_m))
    tracks = tracks.select(_track_means(tracks) >= cut.threshold - ROUNDING)
    return find_pairs(
        BoxStream(truth.frame, truth.id),
        BoxStream(tracks.frame, tracks.id),
        len(result.frames),
        _measure(truth, tracks, config),
    )


def _measure(
    truth: TruthTable, tracks: TrackTable, config: ScoreConfig
) -> Callable[[slice, slice], tuple[F64, F64]]:
    if config.match_by == "distance":
        return centre_distance(truth.centre_m, tracks.centre_m, config.match_distance_m)
    boxes = [boxes7(side.centre_m, side.size_m, side.yaw_rad) for side in (truth, tracks)]
    return overlap(iou_3d, boxes[0], boxes[1])


def _near(result: SceneResult, table: TruthTable | TrackTable, range_m: float) -> Mask:
    ego_xy_m = result.frames.world_T_ego[table.frame, :2, 3]
    near: Mask = np.hypot(*(table.centre_m[:, :2] - ego_xy_m).T) < range_m
    return near


def _seen(truth: TruthTable) -> Mask:
    """(M,) rows from the first to the last frame in which the object has a return."""
    objects, index = np.unique(truth.id, return_inverse=True)
    hit = truth.num_points != 0
    first = np.full(len(objects), np.iinfo(np.int64).max)
    last = np.full(len(objects), -1)
    np.minimum.at(first, index[hit], truth.frame[hit])
    np.maximum.at(last, index[hit], truth.frame[hit])
    seen: Mask = (truth.frame >= first[index]) & (truth.frame <= last[index])
    return seen


def _track_means(tracks: TrackTable) -> F64:
    """(N,) mean score of the track that each row belongs to."""
    _, index = np.unique(tracks.id, return_inverse=True)
    rows = np.maximum(np.bincount(index), 1)
    means: F64 = (np.bincount(index, weights=tracks.score) / rows)[index]
    return means


def _rows(table: BoxTable, label: str) -> BoxTable:
    """The rows of one class, in order of their frame."""
    rows = np.flatnonzero(table.label == label) if label else np.arange(len(table))
    return table.select(rows[np.argsort(table.frame[rows], kind="stable")])


def scene_scores(result: SceneResult, cut: ScoreFilter, config: ScoreConfig) -> ClassScores:
    """Figures of one scene and class; counts add up over scenes."""
    pairs = scene_pairs(result, cut, config)
    near = pairs.within(config.gate)
    counts = clear.clear_counts(near, clear.associate(near))
    return ClassScores(counts, identity.identity_counts(near), hota.hota_counts(pairs))


def _together(parts: Iterable[ClassScores]) -> ClassScores:
    listed = list(parts)
    return ClassScores(
        clear.total(part.clear for part in listed),
        identity.total(part.identity for part in listed),
        hota.total(part.hota for part in listed),
    )
