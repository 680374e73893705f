"""Boxes of one log as arrays, and the pairs of one category."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval.argoverse2.rules import Argoverse2Rules
from mottrack.eval.assignment import linear_sum_assignment
from mottrack.eval.pairs import BoxStream, Measure, Measured, Pairs, Rows, find_pairs


@dataclass(frozen=True, slots=True)
class LogBoxes:
    """N boxes of a log, true or tracked, sorted by frame; within one in the order of the file."""

    frame: I64
    """(N,) index of the annotated time."""
    id: I64
    """(N,) identity."""
    category: I64
    """(N,) index in `rules.CATEGORIES`, -1 for another one."""
    xy_m: F64
    """(N, 2) centre in the city frame."""
    score: F64
    """(N,) confidence; not used of true boxes."""

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, index: Mask) -> LogBoxes:
        """Return the rows that a mask picks."""
        return LogBoxes(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


class Log(NamedTuple):
    """Truth and tracks of one log."""

    name: str
    ego_xy_m: F64
    """(T, 2) place of the vehicle in the city frame at each annotated time."""
    truth: LogBoxes
    tracks: LogBoxes


def within_range(log: Log, rules: Argoverse2Rules) -> Log:
    """Leave out the boxes of both sides that are too far from the vehicle."""
    sides = []
    for boxes in (log.truth, log.tracks):
        apart = np.linalg.norm(boxes.xy_m - log.ego_xy_m[boxes.frame], axis=1)
        sides.append(boxes.select(apart <= rules.max_range_m))
    return Log(log.name, log.ego_xy_m, *sides)


class CategoryPairs(NamedTuple):
    """One category of a log."""

    pairs: Pairs
    """All pairs nearer than the distance of similarity 0."""
    score: F64
    """(P,) of the track boxes."""
    matched: F64
    """(M,) scores of the track boxes that a matching of every frame by total similarity takes."""


def category_pairs(log: Log, category: int, rules: Argoverse2Rules) -> CategoryPairs:
    """Return the pairs of one category, and the scores from which thresholds are chosen.

    That matching knows no gate: as many boxes as there are on the smaller side are matched, even
    such as have nothing in common.
    """
    truth, tracks = (side.select(side.category == category) for side in (log.truth, log.tracks))
    measure = similarity(truth.xy_m, tracks.xy_m, rules.zero_distance_m)
    first, second = (BoxStream(side.frame, side.id) for side in (truth, tracks))
    pairs = find_pairs(first, second, len(log.ego_xy_m), measure)
    matched = [np.zeros(0)]
    both = np.intersect1d(truth.frame, tracks.frame)
    for rows in pairs.by_frame(both):
        # the package's own matrix: which of several equal matchings is taken depends on it
        dense = measure.between(rows.truth, rows.tracks).similarity
        matched.append(tracks.score[rows.tracks][linear_sum_assignment(-dense).column])
    return CategoryPairs(pairs, tracks.score, np.concatenate(matched))


def similarity(truth_xy_m: F64, tracks_xy_m: F64, zero_m: float) -> Measure:
    """Measure 1 - distance / zero_m with the rounding of the package's own distance.

    Args:
        truth_xy_m: (G, 2)
        tracks_xy_m: (P, 2)
        zero_m: distance of similarity 0.
    """

    def measured(apart: F64) -> Measured:
        # not hypot: it rounds otherwise, and a similarity may lie on a threshold
        alike = np.maximum(0, 1 - np.linalg.norm(apart, axis=-1) / zero_m)
        return Measured(1.0 - alike, alike)

    def between(rows: Rows, columns: Rows) -> Measured:
        return measured(truth_xy_m[rows][:, None] - tracks_xy_m[columns][None])

    def each(rows: I64, columns: I64) -> Measured:
        return measured(truth_xy_m[rows] - tracks_xy_m[columns])

    reach = np.array([-zero_m, zero_m])
    return Measure(between, truth_xy_m[:, :1] + reach, tracks_xy_m[:, :1] + 0.0 * reach, each)
