"""Which object belongs to which track (section V-A): gate, nearest neighbour, assignment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from mottrack.core.arrays import F64, I64
from mottrack.geometry.two_by_two import determinant_2x2, inverse_2x2, quadratic_2x2
from mottrack.trackers.association import candidate_pairs
from mottrack.trackers.fixed_lag.config import AssociationConfig
from mottrack.trackers.fixed_lag.engine import Belief


class Predicted(NamedTuple):
    """Tracks (N) carried to the stamp of the objects."""

    belief: Belief
    label: I64
    """(N,) numbers of the class names."""
    slack_m2: F64
    """(N,) variance that a young track's position gets if the flow that it began with was wrong."""


class Seen(NamedTuple):
    """Objects (M) that may belong to a track."""

    xy_m: F64
    """(M, 2)."""
    label: I64
    """(M,) numbers of the class names, as those of the tracks."""
    covariance_m2: F64
    """(M, 2, 2) of the positions."""


class Matches(NamedTuple):
    """Accepted pairs, one-to-one."""

    track: I64
    """(P,) row of the track."""
    object: I64
    """(P,) row of the object."""
    distance: F64
    """(P,) Mahalanobis distance of the position."""
    doubt: F64
    """(P,) the distance if the flow at birth was right, where it was not believed; else 0."""


class _Pairs(NamedTuple):
    """Candidates, under the better of two hypotheses."""

    track: I64
    object: I64
    distance: F64
    doubt: F64
    cost: F64
    """`d^2 + log det S`, plus the price of doubt."""


def match(tracks: Predicted, objects: Seen, config: AssociationConfig) -> Matches:
    """Pairs predicted tracks (N) with objects (M) of the same label.

    With "nearest", every object asks for its nearest track and the nearest object of those that
    ask gets it. With "one_to_one"
    the total of `-2 log(N(off; 0, S) / stray)` is least, where `stray` is the density of objects
    that belong to no track: a pair that is less likely than a chance object is not made, and a new
    track, which is unsure where it is, does not take a settled track's object.

    A flow that saw a fast object at rest would make its track look for it in the wrong place, so
    young tracks have a second hypothesis, at the price of its rarity: the flow was wrong.
    """
    pairs = _candidates(tracks, objects, config)
    if config.rule == "nearest":
        kept = _nearest(pairs.track, pairs.object, pairs.distance)
    else:
        chance = 2.0 * np.log(2.0 * np.pi * config.stray_per_m2)
        kept = _likeliest(pairs.cost + chance, (pairs.track, pairs.object))
    return Matches(pairs.track[kept], pairs.object[kept], pairs.distance[kept], pairs.doubt[kept])


def _candidates(tracks: Predicted, objects: Seen, config: AssociationConfig) -> _Pairs:
    """Pairs within the gates."""
    predicted_m = tracks.belief.mean[:, :2]
    reach_m = np.full(len(objects.xy_m), config.gate_m)
    labels = (tracks.label, objects.label)
    track, found = candidate_pairs(predicted_m, objects.xy_m, reach_m, labels)
    off = objects.xy_m[found] - predicted_m[track]
    near = np.einsum("pi,pi->p", off, off) <= config.gate_m**2
    track, found, off = track[near], found[near], off[near]
    spread = tracks.belief.covariance[track, :2, :2] + objects.covariance_m2[found]
    slack = tracks.slack_m2[track]
    plain, cost = _likelihood(off, spread)
    wide, doubted = _likelihood(off, spread + slack[:, None, None] * np.eye(2))
    doubted -= 2.0 * np.log(config.flow_doubt)
    doubts = (slack > 0.0) & (doubted < cost)
    distance = np.where(doubts, wide, plain)
    doubt, cost = np.where(doubts, plain, 0.0), np.where(doubts, doubted, cost)
    kept = distance <= config.gate
    return _Pairs(track[kept], found[kept], distance[kept], doubt[kept], cost[kept])


def _likelihood(off: F64, covariance: F64) -> tuple[F64, F64]:
    """Mahalanobis distance `d` (P,), and `d^2 + log det S` (P,)."""
    squared = quadratic_2x2(inverse_2x2(covariance), off)
    return np.sqrt(squared), squared + np.log(determinant_2x2(covariance))


def _likeliest(cost: F64, pairs: tuple[I64, I64]) -> I64:
    """One-to-one pairs of least total cost; a pair of positive cost is worse than none."""
    better = np.flatnonzero(cost < 0.0)
    if len(better) == 0:
        return better
    rows, i = np.unique(pairs[0][better], return_inverse=True)
    columns, j = np.unique(pairs[1][better], return_inverse=True)
    matrix = np.zeros((len(rows), len(columns)))
    matrix[i, j] = cost[better]
    index = np.full(matrix.shape, -1, np.int64)
    index[i, j] = better
    chosen = index[linear_sum_assignment(matrix)]
    return np.asarray(chosen[chosen >= 0], np.int64)


def _nearest(track: I64, found: I64, distance: F64) -> I64:
    """Pairs in which the track is the object's nearest and the object the nearest that asked."""
    order = np.lexsort((track, distance))
    _, first = np.unique(found[order], return_index=True)
    asked = order[np.sort(first)]
    _, first = np.unique(track[asked], return_index=True)
    return np.asarray(asked[np.sort(first)], np.int64)
