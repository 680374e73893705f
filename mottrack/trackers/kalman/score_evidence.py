"""What a detection's score says for a track's object, estimated by class while tracking."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.trackers.kalman.config import AssociationConfig

LEAST_DOUBT = 1e-3
"""Probabilities nearer to 0 and 1 count as this near: no detector errs so seldom."""
LEAST_VARIANCE = 1e-2
"""Of log-odds: scores that hardly differ say nothing, however few were seen."""
TAKEN, LEFT = 1, 0


class ScoreEvidence:
    """Log-odds x of scores, weighed by how they tell detections of tracks from all others.

    Of a score that is a probability x is its own, of another the score itself: scores of a logistic
    output are log-odds up to an offset and a factor. That scores are no probabilities is known from
    the first one outside of [0, 1] on.

    With `estimate_score_weight` x is taken as normal with one variance V by class, with mean m_1 of
    the n_1 detections that tracks took and m_0 of the n_0 others, new objects and false ones:

        ln p(x | a track's) - ln p(x | another) = w x + c,    w = (m_1 - m_0) / V,

    of which c is the same for all pairs of a class. The setting `score_weight` is the prior of w;
    it counts as `score_prior_detections` of the rarer kind.
    """

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config
        self._are_probabilities = True
        self._sums = np.zeros((0, 2, 3))
        """(classes, LEFT or TAKEN, number and sums of x and x^2)."""

    def log_odds(self, score: F64) -> F64:
        """Return x (N,) of the scores of a step."""
        if self._are_probabilities and not ((score >= 0.0) & (score <= 1.0)).all():
            self._are_probabilities = False
            self._sums = np.zeros((0, 2, 3))
        if not self._are_probabilities:
            return score
        likely = np.clip(score, LEAST_DOUBT, 1.0 - LEAST_DOUBT)
        found: F64 = np.log(likely / (1.0 - likely))
        return found

    def weight(self, classes: int) -> F64:
        """Return w of each class (C,), at least 0."""
        prior = self._config.score_weight
        weight = np.full(classes, prior)
        known = len(self._sums)
        if known:
            count, total, squares = np.moveaxis(self._sums, 2, 0)
            mean = total / np.maximum(count, 1.0)
            spread = (squares - count * mean**2).sum(axis=1) / np.maximum(count.sum(axis=1), 1.0)
            found = (mean[:, TAKEN] - mean[:, LEFT]) / np.maximum(spread, LEAST_VARIANCE)
            rarer = count.min(axis=1)
            share = rarer / (rarer + self._config.score_prior_detections)
            weight[:known] += share * (found - prior)
        positive: F64 = np.maximum(weight, 0.0)
        return positive

    def record(self, label: I64, log_odds: F64, left: Mask, classes: int) -> None:
        """Count the detections (n,) of a step; `left` says which of them no track took."""
        if not self._config.estimate_score_weight:
            return
        kind = 2 * label + np.where(left, LEFT, TAKEN)
        powers = (np.ones_like(log_odds), log_odds, log_odds**2)
        counted = [np.bincount(kind, p, minlength=2 * classes) for p in powers]
        sums: F64 = np.stack(counted, axis=1, dtype=np.float64).reshape(classes, 2, 3)
        sums[: len(self._sums)] += self._sums
        self._sums = sums
