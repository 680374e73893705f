"""Which boxes of a scene are errors: misses, false positives, switches, at the reported scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import I64
from mottrack.core.result import SceneResult
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.clear import Association, associate, miss_kinds
from mottrack.eval.pairs import BoxStream, Pairs
from mottrack.eval.scores import ScoreConfig, ScoreFilter, scene_pairs

NOBODY = -1


@dataclass(frozen=True)
class SceneError:
    """One error, at a place in the world."""

    frame: int
    """Row of the scene's FrameTable."""
    kind: str
    """"miss", "false positive" or "switch"."""
    detail: str
    """For a miss: "late start", "gap", "early end" or "never found"."""
    label: str
    truth_id: int
    """NOBODY for a false positive."""
    track_id: int
    """NOBODY for a miss."""
    xy_m: tuple[float, float]


def scene_errors(
    result: SceneResult, cuts: Sequence[ScoreFilter], config: ScoreConfig
) -> list[SceneError]:
    """Every error of a scene, frame by frame.

    Args:
        result: of the scene, where it is labelled.
        cuts: class by class, which boxes count.
        config: how boxes are matched.
    """
    errors: list[SceneError] = []
    for cut in cuts:
        pairs = scene_pairs(result, cut, config).within(config.gate)
        errors += _Listing.of(result, pairs).errors()
    return sorted(errors, key=lambda e: (e.frame, e.kind, e.label, e.truth_id, e.track_id))


@dataclass(frozen=True)
class _Listing:
    """The pairs of one class, what was matched, and where the boxes are in the result's tables."""

    result: SceneResult
    pairs: Pairs
    matched: Association
    truth_row: I64
    track_row: I64

    @classmethod
    def of(cls, result: SceneResult, pairs: Pairs) -> _Listing:
        rows = (
            _rows_of(pairs.truth, result.truth),
            _rows_of(pairs.tracks, result.tracks),
        )
        return cls(result, pairs, associate(pairs), *rows)

    def errors(self) -> list[SceneError]:
        hit = self.matched.track_row
        missed, switched = np.flatnonzero(hit < 0), np.flatnonzero(self.matched.switched)
        false = np.setdiff1d(np.arange(len(self.pairs.tracks)), hit)
        truth = self.pairs.truth
        details = miss_kinds(truth.dense_ids(), truth.frame, hit >= 0)
        return (
            [self._of_truth("miss", int(row), details[row]) for row in missed]
            + [self._of_truth("switch", int(row), "") for row in switched]
            + [self._false_positive(int(row)) for row in false]
        )

    def _of_truth(self, kind: str, row: int, detail: str) -> SceneError:
        truth, at = self.result.truth, self.truth_row[row]
        hit = int(self.matched.track_row[row])
        track = NOBODY if hit < 0 else int(self.pairs.tracks.id[hit])
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
            truth_id=NOBODY,
            track_id=int(tracks.id[at]),
            xy_m=(float(tracks.centre_m[at, 0]), float(tracks.centre_m[at, 1])),
        )


def _rows_of(side: BoxStream, table: TruthTable | TrackTable) -> I64:
    """(N,) row of the table that each box of the side is: an identity occurs once a frame."""
    place = {key: row for row, key in enumerate(zip(table.frame, table.id, strict=True))}
    return np.array([place[key] for key in zip(side.frame, side.id, strict=True)], np.int64)
