"""The recall levels of a class, and the scores from which tracks take part at them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.eval.nuscenes.rules import Rules

BESIDE = np.arange(-2, 3)
"""Boxes around a level: its two neighbours, and one more on either side for rounding."""


class Levels(NamedTuple):
    """The recall levels of a class, the highest recall first."""

    threshold: F64
    """(levels,) score from which tracks take part; NaN: the recall is not reached."""
    recall: F64
    """(levels,) the recall that the threshold was chosen for."""

    @property
    def distinct(self) -> F64:
        """The different thresholds, ascending."""
        return np.unique(self.threshold[~np.isnan(self.threshold)])


class ScoreCounts(NamedTuple):
    """How many matched boxes have each score."""

    score: F64
    """(M,) the highest first."""
    boxes: I64
    """(M,)"""

    @classmethod
    def of(cls, scores: F64) -> ScoreCounts:
        """Count each box by itself."""
        return cls(np.sort(scores)[::-1], np.ones(len(scores), np.int64))


def recall_levels(matched: ScoreCounts, truth_boxes: int, rules: Rules) -> Levels:
    """Return the levels that these matched boxes reach; NaN throughout without any."""
    recall = np.linspace(rules.min_recall, 1, rules.levels).round(12)  # as the official code
    ends = np.cumsum(matched.boxes)
    total = int(ends[-1]) if len(ends) else 0
    if not total:
        nothing = np.full(rules.levels, np.nan)
        return Levels(nothing, nothing)
    # of the curve from box to box only the points beside a level matter
    beside = np.floor(recall * truth_boxes).astype(np.int64)[:, None] + BESIDE
    box = np.unique(np.clip(np.r_[beside.ravel(), total], 1, total))
    descending = matched.score[np.searchsorted(ends, box)]
    threshold = np.interp(recall, box / truth_boxes, descending, right=0)
    threshold[recall > total / truth_boxes] = np.nan
    return Levels(threshold[::-1], recall[::-1])
