"""Errors of a scene box by box: misses, false positives, identity switches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mottrack.core.arrays import I64
from mottrack.core.result import SceneResult
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.clear import associate, miss_kinds
from mottrack.eval.pairs import BoxStream
from mottrack.eval.scores import ScoreConfig, ScoreFilter, scene_pairs

NO_ID = -1


@dataclass(frozen=True)
class SceneError:
    """One error and its place."""

    frame: int
    """Row of the scene's FrameTable."""
    kind: str
    """"miss", "false positive" or "switch"."""
    detail: str
    """For a miss: "late start", "gap", "early end" or "never found"."""
    label: str
    truth_id: int
    """NO_ID for a false positive."""
    track_id: int
    """NO_ID for a miss."""
    xy_m: tuple[float, float]
    """Centre of the box, world frame."""


def scene_errors(
    result: SceneResult, filters: Sequence[ScoreFilter], config: ScoreConfig
) -> list[SceneError]:
    """List every error of a scene, ordered by frame.

    Args:
        result: of the scene, restricted to what is labelled.
        filters: per class, the boxes that are evaluated.
        config: how boxes are matched.
    """
    errors: list[SceneError] = []
    for score_filter in filters:
        pairs = scene_pairs(result, score_filter, config).within(config.gate)
        truth = result.truth.select(_rows_of(pairs.truth, result.truth))
        tracks = result.tracks.select(_rows_of(pairs.tracks, result.tracks))
        matched = associate(pairs)
        hit = matched.track_row
        details = miss_kinds(pairs.truth.dense_ids(), pairs.truth.frame, hit >= 0)
        missed, switched = np.flatnonzero(hit < 0).tolist(), np.flatnonzero(matched.switched)
        errors += [_error(truth, row, "miss", str(details[row])) for row in missed]
        for row in switched.tolist():
            track_id = int(tracks.id[hit[row]])
            errors.append(replace(_error(truth, row, "switch"), track_id=track_id))
        false = np.setdiff1d(np.arange(len(tracks)), hit).tolist()
        errors += [_error(tracks, row, "false positive") for row in false]
    return sorted(errors, key=lambda e: (e.frame, e.kind, e.label, e.truth_id, e.track_id))


def _error(boxes: TruthTable | TrackTable, row: int, kind: str, detail: str = "") -> SceneError:
    identity, of_truth = int(boxes.id[row]), isinstance(boxes, TruthTable)
    return SceneError(
        frame=int(boxes.frame[row]),
        kind=kind,
        detail=detail,
        label=str(boxes.label[row]),
        truth_id=identity if of_truth else NO_ID,
        track_id=NO_ID if of_truth else identity,
        xy_m=(float(boxes.centre_m[row, 0]), float(boxes.centre_m[row, 1])),
    )


def _rows_of(boxes: BoxStream, table: TruthTable | TrackTable) -> I64:
    """Return (N,) the table row of each box: an identity occurs once per frame."""
    place = {key: row for row, key in enumerate(zip(table.frame, table.id, strict=True))}
    return np.array([place[key] for key in zip(boxes.frame, boxes.id, strict=True)], np.int64)
