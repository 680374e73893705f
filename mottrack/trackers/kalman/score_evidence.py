"""What a detection's score says for a track's object, estimated by class while tracking."""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
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
        likely = np.minimum(np.maximum(score, LEAST_DOUBT), 1.0 - LEAST_DOUBT)
        found: F64 = np.log(likely / (1.0 - likely))
        return found

    def weight(self, classes: int) -> F64:
        """Return w of each class (C,), at least 0."""
        self._grow(classes)
        config = self._config
        return _weights(self._sums, config.score_weight, config.score_prior_detections)

    def record(self, label: I64, log_odds: F64, left: Mask, classes: int) -> None:
        """Count the detections (n,) of a step; `left` says which of them no track took."""
        if self._config.estimate_score_weight:
            self._grow(classes)
            _count(self._sums, label, log_odds, left)

    def _grow(self, classes: int) -> None:
        new = classes - len(self._sums)
        if new > 0:
            self._sums = np.concatenate([self._sums, np.zeros((new, 2, 3))])


@compiled
def _weights(sums: F64, prior: float, prior_detections: float) -> F64:
    weight = np.empty(len(sums))
    for c in range(len(sums)):
        left, taken = sums[c, LEFT], sums[c, TAKEN]
        rarer = min(left[0], taken[0])
        found = prior
        if rarer > 0.0:
            difference = taken[1] / taken[0] - left[1] / left[0]
            squares = taken[2] - taken[1] ** 2 / taken[0] + left[2] - left[1] ** 2 / left[0]
            found = difference / max(squares / (taken[0] + left[0]), LEAST_VARIANCE)
        share = rarer / (rarer + prior_detections)
        weight[c] = max(prior + share * (found - prior), 0.0)
    return weight


@compiled
def _count(sums: F64, label: I64, log_odds: F64, left: Mask) -> None:
    for i in range(len(label)):
        kind = LEFT if left[i] else TAKEN
        sums[label[i], kind, 0] += 1.0
        sums[label[i], kind, 1] += log_odds[i]
        sums[label[i], kind, 2] += log_odds[i] ** 2
