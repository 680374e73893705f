"""Errors of a scene box by box: misses, false positives, identity switches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import I64, Mask, Texts
from mottrack.core.result import SceneResult
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.clear import Association, associate
from mottrack.eval.pairs import BoxStream, Pairs
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
        errors += _Listing.of(result, pairs).errors()
    return sorted(errors, key=lambda e: (e.frame, e.kind, e.label, e.truth_id, e.track_id))


@dataclass(frozen=True)
class _Listing:
    """The pairs of one class, the matches, and the rows of the boxes in the result's tables."""

    result: SceneResult
    pairs: Pairs
    matched: Association
    truth_row: I64
    track_row: I64

    @classmethod
    def of(cls, result: SceneResult, pairs: Pairs) -> _Listing:
        truth_row = _rows_of(pairs.truth, result.truth)
        track_row = _rows_of(pairs.tracks, result.tracks)
        return cls(result, pairs, associate(pairs), truth_row, track_row)

    def errors(self) -> list[SceneError]:
        hit = self.matched.track_row
        missed, switched = np.flatnonzero(hit < 0), np.flatnonzero(self.matched.switched)
        false = np.setdiff1d(np.arange(len(self.pairs.tracks)), hit)
        details = miss_details(self.pairs.truth, hit >= 0)
        return (
            [self._of_truth("miss", int(row), details[row]) for row in missed]
            + [self._of_truth("switch", int(row), "") for row in switched]
            + [self._false_positive(int(row)) for row in false]
        )

    def _of_truth(self, kind: str, row: int, detail: str) -> SceneError:
        truth, at = self.result.truth, self.truth_row[row]
        hit = int(self.matched.track_row[row])
        track = NO_ID if hit < 0 else int(self.pairs.tracks.id[hit])
        return SceneError(
            frame=int(truth.frame[at]),
            kind=kind,
            detail=detail,
            label=str(truth.label[at]),
            truth_id=int(truth.id[at]),
            track_id=track,
            xy_m=(float(truth.centre_m[at, 0]), float(truth.centre_m[at, 1])),
        )

    def _false_positive(self, row: int) -> SceneError:
        tracks, at = self.result.tracks, self.track_row[row]
        return SceneError(
            frame=int(tracks.frame[at]),
            kind="false positive",
            detail="",
            label=str(tracks.label[at]),
            truth_id=NO_ID,
            track_id=int(tracks.id[at]),
            xy_m=(float(tracks.centre_m[at, 0]), float(tracks.centre_m[at, 1])),
        )


def miss_details(truth: BoxStream, hit: Mask) -> Texts:
    """(G,) what each true box would be as a miss, from where its object is hit before and after."""
    objects = truth.dense_ids()
    count = int(objects.max(initial=-1)) + 1
    first = np.full(count, np.iinfo(np.int64).max)
    last = np.full(count, -1)
    np.minimum.at(first, objects[hit], truth.frame[hit])
    np.maximum.at(last, objects[hit], truth.frame[hit])
    first, last = first[objects], last[objects]
    conditions = [last < 0, truth.frame < first, truth.frame > last]
    return np.select(conditions, ["never found", "late start", "early end"], "gap")


def _rows_of(boxes: BoxStream, table: TruthTable | TrackTable) -> I64:
    """Return (N,) the table row of each box: an identity occurs once per frame."""
    place = {key: row for row, key in enumerate(zip(table.frame, table.id, strict=True))}
    return np.array([place[key] for key in zip(boxes.frame, boxes.id, strict=True)], np.int64)
