"""The scores of a run: everything that a table about stored scene results prints.

Boxes are matched by the distance of their centres over the ground, class by class. All figures
come from one search for candidate pairs per scene and class.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core import SceneResult
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval import clear, hota, identity
from mottrack.eval.flow_error import FlowError, flow_table
from mottrack.eval.pairs import Pairs, Side, centre_distance, find_pairs
from mottrack.eval.velocity_error import (
    ErrorRow,
    VelocityErrorConfig,
    velocity_samples,
    velocity_table,
)

BoxTable = TypeVar("BoxTable", TruthTable, TrackTable)


class ScoreConfig(StrictModel):
    """How boxes are matched."""

    match_distance_m: float = Field(
        default=2.0, gt=0, description="centres nearer than this can match"
    )
    class_agnostic: bool = Field(default=False, description="match boxes of any class (clusters)")
    min_score: float = Field(default=0.0, description="tracks below this score are left out")
    velocity: VelocityErrorConfig = VelocityErrorConfig()


@dataclass(frozen=True, slots=True)
class ClassScores:
    """Counts of one class, or of all classes together."""

    clear: clear.ClearCounts
    identity: identity.IdentityCounts
    hota: hota.HotaCounts

    def as_dict(self) -> dict[str, float]:
        """The figures with their unit in the name; MOTP is a mean distance in metres."""
        counts = self.clear
        return {
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
        plain: dict[str, Any] = _strict(figures)
        return plain


def score(results: Sequence[SceneResult], config: ScoreConfig | None = None) -> Scores:
    """Scores of the scenes together."""
    config = config or ScoreConfig()
    labels = [""] if config.class_agnostic else _labels(results)
    classes = {label: _class_scores(results, label, config) for label in labels}
    flow = [result.flow for result in results if len(result.flow)]
    samples = [velocity_samples(result, config.velocity) for result in results]
    return Scores(
        overall=_together(classes.values()),
        classes={} if config.class_agnostic else classes,
        velocity=velocity_table(samples, config.velocity),
        flow=flow_table(flow) if flow else {},
    )


def _labels(results: Iterable[SceneResult]) -> list[str]:
    """The classes in truth or tracks, in alphabetical order."""
    named = [np.unique(t.label) for result in results for t in (result.truth, result.tracks)]
    return sorted({str(name) for names in named for name in names})


def _class_scores(results: Iterable[SceneResult], label: str, config: ScoreConfig) -> ClassScores:
    parts = [_scene_scores(scene_pairs(result, label, config), config) for result in results]
    return _together(parts)


def scene_pairs(result: SceneResult, label: str, config: ScoreConfig) -> Pairs:
    """Candidate pairs of a scene for one class; every class where the label is empty."""
    truth, tracks = _rows(result.truth, label), _rows(result.tracks, label)
    tracks = tracks.select(tracks.score >= config.min_score)
    return find_pairs(
        Side(truth.frame, truth.id),
        Side(tracks.frame, tracks.id),
        len(result.frames),
        centre_distance(truth.centre_m, tracks.centre_m, config.match_distance_m),
    )


def _rows(table: BoxTable, label: str) -> BoxTable:
    """The rows of one class, in order of their frame."""
    rows = np.flatnonzero(table.label == label) if label else np.arange(len(table))
    return table.select(rows[np.argsort(table.frame[rows], kind="stable")])


def _scene_scores(pairs: Pairs, config: ScoreConfig) -> ClassScores:
    near = pairs.within(config.match_distance_m)
    counts = clear.clear_counts(near, clear.associate(near))
    return ClassScores(counts, identity.identity_counts(near), hota.hota_counts(pairs))


def _together(parts: Iterable[ClassScores]) -> ClassScores:
    listed = list(parts)
    return ClassScores(
        clear.total(part.clear for part in listed),
        identity.total(part.identity for part in listed),
        hota.total(part.hota for part in listed),
    )


def _strict(value: Any) -> Any:
    """The same structure with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: _strict(item) for key, item in value.items()}
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
