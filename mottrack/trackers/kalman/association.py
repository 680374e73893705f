"""Association of one step's detections with the predicted tracks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64
from mottrack.trackers.association import (
    ASSIGNMENTS,
    candidate_pairs,
    centre_distance_m,
    overlap_cost,
)
from mottrack.trackers.kalman.config import AssociationConfig, KalmanConfig
from mottrack.trackers.kalman.detections import Detections
from mottrack.trackers.kalman.pair_terms import Compared, Expected, Observed, pair_terms
from mottrack.trackers.velocity_source.failures import Failures

Pairs = tuple[I64, I64]

ROUNDING = 1e-6
"""Relative margin of the candidate search, so that the exact gate decides at its very edge."""

COMPARED = {"box": (2, 7), "xyz": (2, 3), "xy": (2, 2)}
"""Numbers of the box that count beside x and y: first, and end."""


@dataclass(frozen=True, slots=True)
class Predicted:
    """N tracks predicted to the time of the detections, as far as association needs them."""

    mean: F64
    """(N, 11) states."""
    xy_velocity_covariance: F64
    """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
    z_yaw_size_variance: F64
    """(N, 5) variances of z, yaw, l, w, h."""
    label: I64
    """(N,) index of the class."""
    place: F64
    """(N, 2) where the track would stand (`standing`)."""
    spread: F64
    """(N, 2, 2) covariance of that place."""
    p_standing: F64
    """(N,) probability that it stands."""
    failures: Failures
    """How measured velocities err."""

    def select(self, index: NDArray[Any]) -> Predicted:
        """Return the rows that a mask or an index picks."""
        rows = {name: getattr(self, name)[index] for name in self.__slots__ if name != "failures"}
        return replace(self, **rows)


def associate(
    seen: Detections, tracks: Predicted, config: KalmanConfig, labels: list[str]
) -> Pairs:
    """Return matched tracks and detections, two index arrays (P,) sorted by track.

    With a second stage, detections below its score are offered only to the tracks that found none
    among the others. `labels` are the names of the class indices.
    """
    second = config.second_stage
    if not second.enabled:
        return _sorted(_match(seen, tracks, config.association, labels))
    strong = seen.score >= second.score
    sure, unsure = np.flatnonzero(strong), np.flatnonzero(~strong)
    rows, columns = _match(seen.select(sure), tracks, config.association, labels)
    left = np.setdiff1d(np.arange(len(tracks.mean)), rows)
    more = _match(seen.select(unsure), tracks.select(left), second.association, labels)
    return _sorted((np.append(rows, left[more[0]]), np.append(sure[columns], unsure[more[1]])))


def _match(
    seen: Detections, tracks: Predicted, config: AssociationConfig, labels: list[str]
) -> Pairs:
    """Return tracks and detections that one round of gate, cost and assignment joins."""
    gate = np.array([config.gates.get(label, config.gate) for label in labels])[tracks.label]
    reach = np.minimum(_largest_offset_m(seen, tracks, gate, config), config.max_distance_m)
    groups = (seen.label, tracks.label) if config.class_aware else None
    pairs = candidate_pairs(seen.box[:, :2], tracks.mean[:, :2], reach, groups)
    distance, cost = COSTS[config.metric](seen, tracks, pairs, config)
    inside = distance <= gate[pairs[1]]
    pairs = (pairs[0][inside], pairs[1][inside])
    chosen = ASSIGNMENTS[config.method](cost[inside], pairs)
    return pairs[1][chosen], pairs[0][chosen]


def _sorted(matched: Pairs) -> Pairs:
    order = np.argsort(matched[0])
    return matched[0][order], matched[1][order]


def _largest_offset_m(
    seen: Detections, tracks: Predicted, gate: F64, config: AssociationConfig
) -> F64:
    """Return offsets (M, 2) along x and y beyond which no detection passes a track's gate."""
    if config.metric == "mahalanobis":
        noise = seen.xy_covariance.reshape(-1, 4)[:, ::3].max(axis=0, initial=0.0)
        variance = tracks.xy_velocity_covariance.reshape(-1, 16)[:, :6:5] + noise
        offset: F64 = gate[:, None] * np.sqrt(variance) * (1.0 + ROUNDING)
        return offset
    if config.metric == "centre":
        return np.tile(gate[:, None], 2)
    # boxes overlap only where their circumscribed circles do
    reach = 0.5 * _diagonal_m(tracks.mean) + 0.5 * _diagonal_m(seen.box).max(initial=0.0)
    return np.tile(reach[:, None], 2)


def _diagonal_m(box: F64) -> F64:
    return np.hypot(box[:, 4], box[:, 5])


def _mahalanobis_cost(
    seen: Detections, tracks: Predicted, pairs: Pairs, config: AssociationConfig
) -> tuple[F64, F64]:
    """Return the distance sqrt(r' S^-1 r) and the cost of each pair, (P,) twice.

    S = H P H' + R is taken block by block: (x, y), the numbers of `config.components`, and where
    a velocity was measured (d_x, d_y) given (x, y). The cost is the distance, or, where the clutter
    density is known, -2 ln p(x, y | track): a track with a wide covariance does not take what a
    certain one explains better, and a pair less likely than clutter is refused. Of several
    detections near a track, the evidence of their scores counts (`score_evidence`): a duplicate or
    a false alarm beside an object does not take its track. The gate goes by position alone.
    """
    first, end = COMPARED[config.components]
    compared = Compared(first, end, _velocity_limit(config), tracks.failures)
    squared, nll = pair_terms(pairs, *_kernel_arguments(seen, tracks), compared)
    distance = np.sqrt(squared)
    if config.float32:
        distance = distance.astype(np.float32).astype(np.float64)
    if config.clutter_density_per_m2 is None:
        return distance, distance
    allowed = np.where(nll > seen.nll_gate[pairs[0]], np.inf, distance)
    return allowed, nll - 2.0 * seen.evidence[pairs[0]]


def _velocity_limit(config: AssociationConfig) -> float:
    """Return what a velocity adds to d^2 at most; below 0 it is not compared at all."""
    if not config.velocity:
        return -1.0
    if config.clutter_density_per_m2 is not None:
        return 0.0
    return (config.velocity_limit or np.inf) ** 2


@dataclass(frozen=True, slots=True)
class Innovations:
    """Normalised squared innovations r' S^-1 r of P matched detections, to test consistency."""

    box: F64
    """(P,) of all seven numbers of the box."""
    xy: F64
    """(P,) of x and y."""
    source: I64
    """(P,) row of the detection in the objects handed over."""


def innovations(seen: Detections, tracks: Predicted, pairs: Pairs) -> Innovations:
    """Return the normalised squared innovations of pairs of detection and track."""
    arguments = _kernel_arguments(seen, tracks)
    box, xy = (
        pair_terms(pairs, *arguments, Compared(*COMPARED[which], -1.0, tracks.failures))[0]
        for which in ("box", "xy")
    )
    return Innovations(box, xy, seen.source[pairs[0]])


def _kernel_arguments(seen: Detections, tracks: Predicted) -> tuple[Observed, Expected]:
    observed = Observed(*(getattr(seen, name) for name in Observed._fields))
    return observed, Expected(*(getattr(tracks, name) for name in Expected._fields))


def _centre_cost(
    seen: Detections, tracks: Predicted, pairs: Pairs, _config: AssociationConfig
) -> tuple[F64, F64]:
    """Return the distance of the centres in metres, twice."""
    distance = centre_distance_m(seen.box[:, :2], tracks.mean[:, :2], pairs)
    return distance, distance


def _overlap_cost(
    seen: Detections, tracks: Predicted, pairs: Pairs, config: AssociationConfig
) -> tuple[F64, F64]:
    """Return 1 - overlap, twice; `config.metric` names the overlap."""
    columns = [0, 1, 2, 4, 5, 6, 3]
    cost = overlap_cost(seen.box[:, columns], tracks.mean[:, columns], pairs, config.metric)
    return cost, cost


PairCost = Callable[[Detections, Predicted, Pairs, AssociationConfig], tuple[F64, F64]]
COSTS: dict[str, PairCost] = {
    "mahalanobis": _mahalanobis_cost,
    "centre": _centre_cost,
    "iou_bev": _overlap_cost,
    "iou_3d": _overlap_cost,
    "giou_bev": _overlap_cost,
    "giou_3d": _overlap_cost,
}
"""Distance (for the gate) and cost (for the assignment) of pairs, by metric."""
