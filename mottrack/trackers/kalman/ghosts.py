"""Which tracks of a finished scene are false: a mixture of two kinds, estimated from the tracks.

A true object is detected again and again; a false detection is followed by few others in the same
place, and scores lower. So the number of detections of a track is geometric, with another chance of
going on for objects than for ghosts, and its mean score normal. Chances, scores and the share of
ghosts are fitted by class with expectation maximisation, starting from single detections as ghosts.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64

ROUNDS = 50
"""Of expectation maximisation: five numbers are fitted, and a round costs microseconds."""
LEAST_TRACKS = 20
"""Of a class with fewer tracks a mixture says nothing: all are kept."""
LEAST_SHARE = 0.02
"""Least variance of a component's scores, as a share of all: it must not close on one score."""


def p_real(hits: I64, score: F64) -> F64:
    """Return the probability (n,) that tracks of one class are of objects.

    Args:
        hits: (n,) detections of each track, at least one.
        score: (n,) mean score of its detections.
    """
    real = (hits > 1).astype(np.float64)
    if len(hits) < LEAST_TRACKS or not 0 < real.sum() < len(hits):
        return np.ones(len(hits))
    spread = max(float(score.std()), np.finfo(np.float64).eps)
    x = (score - score.mean()) / spread
    for _ in range(ROUNDS):
        odds = _log_density(hits, x, real) - _log_density(hits, x, 1.0 - real)
        real = 1.0 / (1.0 + np.exp(np.clip(-odds, -700.0, 700.0)))
    # the kind that goes on is that of objects, whatever the start became
    longer = np.average(hits, weights=real + 1e-12) >= np.average(hits, weights=1 - real + 1e-12)
    return real if longer else 1.0 - real


def _log_density(hits: I64, score: F64, weight: F64) -> F64:
    """Return ln of share times density (n,) of the kind fitted with these weights (n,)."""
    # one more of each outcome: a chance of 0 or 1 is never certain
    total = float(weight.sum()) + 1e-12
    going_on = (float(weight @ (hits - 1)) + 1.0) / (float(weight @ hits) + 2.0)
    mean = float(weight @ score) / total
    variance = max(float(weight @ (score - mean) ** 2) / total, LEAST_SHARE)
    length = (hits - 1) * np.log(going_on) + np.log1p(-going_on)
    likely = -0.5 * ((score - mean) ** 2 / variance + np.log(2.0 * np.pi * variance))
    return np.asarray(np.log(total / len(hits)) + length + likely)
