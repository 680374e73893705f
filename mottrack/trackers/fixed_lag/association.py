"""Association of objects with tracks (section V-A): gates, nearest neighbour, assignment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from mottrack.core.arrays import F64, I64
from mottrack.geometry.two_by_two import (
    determinant_2x2,
    inverse_2x2,
    mahalanobis_2x2,
    quadratic_2x2,
)
from mottrack.trackers.association import candidate_pairs
from mottrack.trackers.fixed_lag.config import FixedLagAssociationConfig
from mottrack.trackers.fixed_lag.engine import Estimate
from mottrack.trackers.fixed_lag.nodes import Measurements

REFERENCE_STEP_S = 0.25
"""Longest step at which `gate_m` and `clutter_density_per_m2` hold for tracks of unknown velocity.

The position of a new track without a measured velocity has the variance (10 m/s * dt)^2, so its
likelihood falls with dt^2. Up to 0.25 s it still exceeds the default clutter density of 0.01/m^2,
at speeds up to 14 m/s; from 0.4 s on nothing would be associated with it.
"""


class PredictedTracks(NamedTuple):
    """Tracks (N) carried to the stamp of the objects."""

    estimate: Estimate
    label: I64
    """(N,) numbers of the class names."""
    inflation_m2: F64
    """(N,) variance added to the position if the first velocity was an outlier; 0 if settled."""
    scale: F64
    """(N,) length by which `gate_m` is multiplied; the clutter density falls with its square."""


class SeenObjects(NamedTuple):
    """Objects (M) that may belong to a track."""

    xy_m: F64
    """(M, 2)."""
    label: I64
    """(M,) numbers of the class names, as those of the tracks."""
    covariance_m2: F64
    """(M, 2, 2) of the positions."""


class Matches(NamedTuple):
    """P pairs; candidates, or accepted one-to-one."""

    track: I64
    """(P,) row of the track."""
    object: I64
    """(P,) row of the object."""
    distance: F64
    """(P,) Mahalanobis distance of the position, under the likelier hypothesis."""
    outlier_distance: F64
    """(P,) distance under the first velocity where that was taken for an outlier; else 0."""
    cost: F64
    """(P,) `d^2 + log det S`, plus `-2 log p` of the hypothesis of an outlier."""

    def select(self, rows: I64) -> Matches:
        """Return the pairs that an index picks."""
        return Matches(
            self.track[rows],
            self.object[rows],
            self.distance[rows],
            self.outlier_distance[rows],
            self.cost[rows],
        )


def associate_clusters(
    tracks: PredictedTracks, objects: SeenObjects, config: FixedLagAssociationConfig
) -> Matches:
    """Return one-to-one pairs of predicted tracks (N) and objects (M) of the same label.

    With "nearest", every object asks for its nearest track and gets it unless another object is
    nearer. With "one_to_one" the total of `-2 log(N(off; 0, S) / lambda)` is minimal, lambda being
    the clutter density: a pair that is less likely than clutter is refused, and a new track, whose
    position is uncertain, does not take an established track's object.

    A flow that measured a fast object at rest makes its track search in the wrong place, so young
    tracks have a second hypothesis, weighted by its probability: the velocity was an outlier.
    """
    pairs = _candidates(tracks, objects, config)
    if config.rule == "nearest":
        return pairs.select(_nearest(pairs))
    clutter = 2.0 * np.log(2.0 * np.pi * config.clutter_density_per_m2)
    excess = pairs.cost + clutter - 4.0 * np.log(tracks.scale[pairs.track])
    return pairs.select(_likeliest(excess, (pairs.track, pairs.object)))


def _candidates(
    tracks: PredictedTracks, objects: SeenObjects, config: FixedLagAssociationConfig
) -> Matches:
    """Return the pairs within the gates."""
    predicted_m = tracks.estimate.mean[:, :2]
    gate_m = config.gate_m * tracks.scale
    reach_m = np.full(len(objects.xy_m), gate_m.max(initial=0.0))
    labels = (tracks.label, objects.label)
    track, found = candidate_pairs(predicted_m, objects.xy_m, reach_m, labels)
    off = objects.xy_m[found] - predicted_m[track]
    near = np.einsum("pi,pi->p", off, off) <= gate_m[track] ** 2
    track, found, off = track[near], found[near], off[near]
    spread = tracks.estimate.covariance[track, :2, :2] + objects.covariance_m2[found]
    inflation = tracks.inflation_m2[track]
    plain, cost = _likelihood(off, spread)
    wide, outlier_cost = _likelihood(off, spread + inflation[:, None, None] * np.eye(2))
    outlier_cost -= 2.0 * np.log(config.p_birth_velocity_outlier)
    outlier = (inflation > 0.0) & (outlier_cost < cost)
    distance = np.where(outlier, wide, plain)
    pairs = Matches(
        track,
        found,
        distance,
        np.where(outlier, plain, 0.0),
        np.where(outlier, outlier_cost, cost),
    )
    return pairs.select(np.flatnonzero(distance <= config.gate))


def _likelihood(off: F64, covariance: F64) -> tuple[F64, F64]:
    """Return the Mahalanobis distance `d` (P,), and `d^2 + log det S` (P,)."""
    squared = quadratic_2x2(inverse_2x2(covariance), off)
    return np.sqrt(squared), squared + np.log(determinant_2x2(covariance))


def _likeliest(cost: F64, pairs: tuple[I64, I64]) -> I64:
    """Return one-to-one pairs of least total cost; a pair of positive cost is worse than none."""
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
    return chosen[chosen >= 0]


def _nearest(pairs: Matches) -> I64:
    """Return pairs whose track is the object's nearest, one object (the nearest) per track."""
    order = np.lexsort((pairs.track, pairs.distance))
    _, first = np.unique(pairs.object[order], return_index=True)
    asked = order[np.sort(first)]
    _, first = np.unique(pairs.track[asked], return_index=True)
    return asked[np.sort(first)]


def velocity_innovation(estimate: Estimate, matches: Matches, measurements: Measurements) -> F64:
    """Return the normalised innovation (P,) of the velocity; 0 where none was measured."""
    seen = measurements.has_velocity[matches.object]
    rows, tracks = matches.object[seen], matches.track[seen]
    off = measurements.velocity_mps[rows] - estimate.mean[tracks, 2:4]
    spread = estimate.covariance[tracks, 2:4, 2:4] + measurements.velocity_covariance_m2ps2[rows]
    distance = np.zeros(len(seen))
    distance[seen] = mahalanobis_2x2(off, spread)
    return distance
