"""Which object belongs to which track (section V-A): gate, nearest neighbour, assignment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mottrack.core.objects import Objects
from mottrack.trackers.association import candidate_pairs, mahalanobis
from mottrack.trackers.fixed_lag.config import AssociationConfig
from mottrack.trackers.fixed_lag.engine import Belief
from mottrack.trackers.fixed_lag.motion import F64

I64 = NDArray[np.int64]


class Matches(NamedTuple):
    """Accepted pairs, one-to-one."""

    track: I64
    """(P,) row of the track."""
    object: I64
    """(P,) row of the object."""
    distance: F64
    """(P,) Mahalanobis distance of the position."""


def match(
    belief: Belief,
    labels: NDArray[np.str_],
    objects: Objects,
    noise: F64,
    config: AssociationConfig,
) -> Matches:
    """Pairs predicted tracks (N) with objects (M) of the same label.

    `noise` (M, 2, 2) is the covariance of the objects' positions. With "nearest", every object
    asks for its nearest track and the nearest object of those that ask gets it. With "one_to_one"
    the total of `-2 log(N(off; 0, S) / stray)` is least, where `stray` is the density of objects
    that belong to no track: a pair that is less likely than a chance object is not made, and a new
    track, which is unsure where it is, does not take a settled track's object.
    """
    _, group = np.unique(np.concatenate([labels, objects.label]), return_inverse=True)
    groups = (group[: len(labels)].astype(np.int64), group[len(labels) :].astype(np.int64))
    xy_m = (belief.mean[:, :2], objects.centre_m[:, :2])
    reach_m = np.full(len(objects), config.gate_m)
    track, found = candidate_pairs(*xy_m, reach_m, groups)
    off = xy_m[1][found] - xy_m[0][track]
    spread = belief.covariance[track, :2, :2] + noise[found]
    distance = mahalanobis(off, spread)
    near = (distance <= config.gate) & (np.einsum("pi,pi->p", off, off) <= config.gate_m**2)
    track, found, distance, spread = track[near], found[near], distance[near], spread[near]
    if config.rule == "nearest":
        kept = _nearest(track, found, distance)
    else:
        chance = 2.0 * np.log(2.0 * np.pi * config.stray_per_m2)
        kept = _likeliest(distance**2 + np.log(np.linalg.det(spread)) + chance, (track, found))
    return Matches(track[kept], found[kept], distance[kept])


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
