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
        config = self._config
        self._make_room(classes)
        return _weights(self._sums, config.score_weight, config.score_prior_detections)

    def record(self, label: I64, log_odds: F64, left: Mask, classes: int) -> None:
        """Count the detections (n,) of a step; `left` says which of them no track took."""
        if self._config.estimate_score_weight:
            self._make_room(classes)
            _count(self._sums, label, log_odds, left)

    def _make_room(self, classes: int) -> None:
        missing = classes - len(self._sums)
        if missing > 0:
            self._sums = np.concatenate([self._sums, np.zeros((missing, 2, 3))])


@compiled
def _weights(sums: F64, prior: float, prior_detections: float) -> F64:
    weights = np.empty(len(sums))
    for c in range(len(sums)):
        least, total, means, inner = np.inf, 0.0, np.zeros(2), 0.0
        for kind in range(2):
            count, first, second = sums[c, kind]
            means[kind] = first / max(count, 1.0)
            inner += second - count * means[kind] ** 2
            least, total = min(least, count), total + count
        variance = max(inner / max(total, 1.0), LEAST_VARIANCE)
        found = (means[TAKEN] - means[LEFT]) / variance
        share = least / (least + prior_detections)
        weights[c] = max(prior + share * (found - prior), 0.0)
    return weights


@compiled
def _count(sums: F64, label: I64, log_odds: F64, left: Mask) -> None:
    for i in range(len(label)):
        kind = LEFT if left[i] else TAKEN
        for power in range(3):
            sums[label[i], kind, power] += log_odds[i] ** power
