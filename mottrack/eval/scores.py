"""Scores of a scene, and what they are made of; those of many scenes are in `evaluation`.

Boxes are matched by the distance of their centres over the ground, or by 3-D IoU, class by class.
CLEAR, IDF1 and HOTA come from one search for candidate pairs per scene and class; AMOTA and AMOTP
have rules of their own, and always go by distance.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core import SceneResult
from mottrack.core.arrays import F64, Mask
from mottrack.core.data_frames import Tabular
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval import clear, hota, identity
from mottrack.eval.flow_error import FlowError
from mottrack.eval.nuscenes.metrics import Curves
from mottrack.eval.nuscenes.racks import outside_racks
from mottrack.eval.pairs import (
    BoxStream,
    Extended,
    Measure,
    Pairs,
    centre_distance,
    find_pairs,
    iou_gate,
    overlap,
)
from mottrack.eval.region import Region
from mottrack.eval.velocity_error import ErrorRow, VelocityErrorConfig
from mottrack.formats.strict_json import strict
from mottrack.geometry.iou import boxes7, iou_3d

ROUNDING = 1e-9
"""A threshold is the mean score of some track, added up in another order: this near is equal."""
MatchBy = Literal["distance", "iou"]
BoxTable = TypeVar("BoxTable", TruthTable, TrackTable)


class ScoreConfig(StrictModel):
    """How boxes are matched."""

    match_by: MatchBy = "distance"
    match_distance_m: float = Field(default=2.0, gt=0, description="centres nearer than this match")
    match_iou: float = Field(default=0.25, gt=0, le=1, description="3-D IoU from which boxes match")
    class_agnostic: bool = Field(default=False, description="match boxes of any class (clusters)")
    min_score: float | None = Field(
        default=None,
        description="tracks of a lower mean score are left out; null: per class what gives the "
        "best MOTA, as the official evaluation reports it",
    )
    region: Region | None = Field(
        default=None, description="where true boxes, tracks and cells count; null: everywhere"
    )
    velocity: VelocityErrorConfig = VelocityErrorConfig()

    @property
    def gate(self) -> float:
        """Pairs whose distance (metres, or 1 - IoU) is below this may match."""
        if self.match_by == "iou":
            return iou_gate(self.match_iou)
        return self.match_distance_m


@dataclass(frozen=True, slots=True)
class ClassScores:
    """Metrics of one class, or of all classes together."""

    clear: clear.ClearCounts
    identity: identity.IdentityCounts
    hota: hota.HotaCounts
    amota: float = float("nan")
    """Official AMOTA; NaN where the evaluation is class-agnostic."""
    amotp_m: float = float("nan")
    """Official AMOTP, metres."""
    mean_mota: float = float("nan")
    """Of all classes together: the official MOTA, the mean over the classes."""
    mean_motp_m: float = float("nan")
    """Likewise MOTP, metres."""
    match_by: MatchBy = "distance"

    def as_dict(self) -> dict[str, float]:
        """Return the metrics with their unit in the name; NaN for the MOTP of the other measure."""
        counts = self.clear
        averaged = self.mean_mota == self.mean_mota
        own = self.mean_motp_m if averaged else counts.motp
        motp = {"distance": float("nan"), "iou": float("nan"), self.match_by: own}
        return {
            "amota": self.amota,
            "amotp_m": self.amotp_m,
            "mota": self.mean_mota if averaged else counts.mota,
            "motp_m": motp["distance"],
            "motp_iou_distance": motp["iou"],
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
class Scores(Tabular):
    """All metrics of a run."""

    overall: ClassScores
    classes: dict[str, ClassScores]
    velocity: dict[str, ErrorRow]
    """Row name to velocity error (velocity_error.velocity_table)."""
    flow: dict[str, FlowError]
    """Row name to flow error (flow_error.flow_table); empty where no flow was sampled."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers for scores.json; a metric that does not exist is None."""
        metrics = {
            "overall": self.overall.as_dict(),
            "classes": {name: scores.as_dict() for name, scores in self.classes.items()},
            "velocity_error": {name: asdict(row) for name, row in self.velocity.items()},
            "flow_error": {name: asdict(row) for name, row in self.flow.items()},
        }
        plain: dict[str, Any] = strict(metrics)
        return plain

    def flat(self) -> dict[str, NDArray[Any]]:
        """Return a row for each figure: table, row (class or category), metric, value."""
        tables = {
            "tracking": {"all": self.overall.as_dict()}
            | {name: scores.as_dict() for name, scores in self.classes.items()},
            "velocity_error": {name: asdict(row) for name, row in self.velocity.items()},
            "flow_error": {name: asdict(row) for name, row in self.flow.items()},
        }
        rows = [
            (table, row, metric, value)
            for table, parts in tables.items()
            for row, figures in parts.items()
            for metric, value in figures.items()
        ]
        names = ("table", "row", "metric", "value")
        kinds = (np.str_, np.str_, np.str_, np.float64)
        columns = zip(*rows, strict=True)
        return {n: np.array(c, k) for n, k, c in zip(names, kinds, columns, strict=True)}


@dataclass(frozen=True, slots=True)
class ScoreFilter:
    """Which boxes of one class count."""

    label: str
    """The class; empty: every class."""
    threshold: float = -np.inf
    """Least mean score of a track."""
    range_m: float = np.inf
    """Boxes at least this far from the vehicle are left out, as the official rules do."""


def scored_part(result: SceneResult, config: ScoreConfig, *, truth: bool = True) -> SceneResult:
    """Return the boxes that lie where objects are labelled, and in the region if there is one.

    The velocity error keeps `truth` beyond the region: a track at its border may lie on it.
    """
    labelled = result.where_labelled()
    return labelled if config.region is None else config.region.crop(labelled, truth=truth)


def best_threshold(curves: Curves, config: ScoreConfig) -> float:
    """Return the configured least score, or that of the level with the best MOTA."""
    if config.min_score is not None:
        return config.min_score
    if np.isnan(curves["mota"]).all() or np.isnan(curves["confidence"]).all():
        return np.inf  # nothing of this class is ever matched: no track at all scores best
    reached = np.where(np.isnan(curves["confidence"]), -np.inf, curves["mota"])
    return float(curves["confidence"][int(np.nanargmax(reached))])


def scene_pairs(result: SceneResult, score_filter: ScoreFilter, config: ScoreConfig) -> Pairs:
    """Return the candidate pairs of a scene for one class; every class where the label is empty."""
    truth, tracks = selected(result, score_filter)
    return find_pairs(
        BoxStream(truth.frame, truth.id),
        BoxStream(tracks.frame, tracks.id),
        len(result.frames),
        _measure(truth, tracks, config),
    )


def selected(result: SceneResult, score_filter: ScoreFilter) -> tuple[TruthTable, TrackTable]:
    """Return the true boxes and the track boxes that count, in order of their frame."""
    counted = _seen(result.truth) & outside_racks(result.truth, result.truth)
    truth = _rows(result.truth.select(counted), score_filter.label)
    evaluated = outside_racks(result.tracks, result.truth)
    tracks = _rows(result.tracks.select(evaluated), score_filter.label)
    truth = truth.select(_near(result, truth, score_filter.range_m))
    tracks = tracks.select(_near(result, tracks, score_filter.range_m))
    return truth, tracks.select(_track_means(tracks) >= score_filter.threshold - ROUNDING)


def _measure(truth: TruthTable, tracks: TrackTable, config: ScoreConfig) -> Measure:
    if config.match_by == "distance":
        return centre_distance(truth.centre_m, tracks.centre_m, config.match_distance_m)
    return overlap(iou_3d, _extended(truth), _extended(tracks))


def _extended(table: TruthTable | TrackTable) -> Extended:
    reach_m = np.hypot(table.size_m[:, 0], table.size_m[:, 1])[:, None] / 2  # at any heading
    boxes = boxes7(table.centre_m, table.size_m, table.yaw_rad)
    return Extended(boxes, table.centre_m[:, :1] + reach_m * np.array([-1.0, 1.0]))


def _near(result: SceneResult, table: TruthTable | TrackTable, range_m: float) -> Mask:
    ego_xy_m = result.frames.world_T_ego[table.frame, :2, 3]
    apart_m = table.centre_m[:, :2] - ego_xy_m
    return np.hypot(apart_m[:, 0], apart_m[:, 1]) < range_m


def _seen(truth: TruthTable) -> Mask:
    """(M,) rows from the first to the last frame in which the object has a return."""
    _, object_of = np.unique(truth.id, return_inverse=True)
    first, last = clear.hit_span(object_of, truth.frame, truth.num_points != 0)
    return (truth.frame >= first) & (truth.frame <= last)


def _track_means(tracks: TrackTable) -> F64:
    """(N,) mean score of the track that each row belongs to."""
    _, index = np.unique(tracks.id, return_inverse=True)
    rows = np.maximum(np.bincount(index), 1)
    return (np.bincount(index, weights=tracks.score) / rows)[index]


def _rows(table: BoxTable, label: str) -> BoxTable:
    """Return the rows of one class, in order of their frame."""
    rows = np.flatnonzero(table.label == label) if label else np.arange(len(table))
    return table.select(rows[np.argsort(table.frame[rows], kind="stable")])


def scene_scores(
    result: SceneResult, score_filter: ScoreFilter, config: ScoreConfig
) -> ClassScores:
    """Return the metrics of one scene and class; their counts add up over scenes."""
    pairs = scene_pairs(result, score_filter, config)
    near = pairs.within(config.gate)
    counts = clear.clear_counts(near, clear.associate(near))
    parts = identity.identity_counts(near), hota.hota_counts(pairs)
    return ClassScores(counts, *parts, match_by=config.match_by)


def together(parts: Iterable[ClassScores], config: ScoreConfig) -> ClassScores:
    """Return the metrics of several scenes or classes together; AMOTA and AMOTP do not add up."""
    listed = list(parts)
    return ClassScores(
        clear.total(part.clear for part in listed),
        identity.total(part.identity for part in listed),
        hota.total(part.hota for part in listed),
        match_by=config.match_by,
    )
