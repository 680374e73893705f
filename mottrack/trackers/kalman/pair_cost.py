"""How far a detection is from a predicted track, for the pairs that may match."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.pose import wrap_angle
from mottrack.trackers.association import centre_distance_m
from mottrack.trackers.kalman.config import AssociationConfig
from mottrack.trackers.kalman.detections import Detections
from mottrack.trackers.kalman.pair_terms import Expected, Observed, pair_terms
from mottrack.trackers.kalman.predicted import Predicted

Pairs = tuple[I64, I64]
PairCost = Callable[[Detections, Predicted, Pairs, AssociationConfig], tuple[F64, F64]]

ROUNDING = 1e-6
"""Slack of the first look, so that the exact gate decides at its very edge."""

COMPARED = {"box": (2, 7), "position": (2, 3), "planar": (2, 2)}
"""Which numbers of the box count beside x and y: from, and up to."""


def largest_offset_m(
    seen: Detections, tracks: Predicted, gate: F64, config: AssociationConfig
) -> F64:
    """Offsets along x and y, (M, 2), beyond which no detection can pass the gate of a track."""
    offset = np.full((len(tracks.mean), 2), np.inf)
    if config.metric == "centre":
        offset[:] = gate[:, None]
    elif config.metric.startswith("iou"):
        offset[:] = 0.5 * _diagonal_m(tracks.mean)[:, None]
        offset += 0.5 * _diagonal_m(seen.box).max(initial=0.0)
    elif config.metric == "mahalanobis":
        noise = np.diagonal(seen.position, axis1=1, axis2=2).max(axis=0, initial=0.0)
        spread = np.sqrt(np.diagonal(tracks.planar, axis1=1, axis2=2)[:, :2] + noise)
        offset[:] = gate[:, None] * spread * (1.0 + ROUNDING)
    return offset


def _diagonal_m(box: F64) -> F64:
    return np.hypot(box[:, 4], box[:, 5])


def mahalanobis_cost(
    seen: Detections, tracks: Predicted, pairs: Pairs, config: AssociationConfig
) -> tuple[F64, F64]:
    """Distance sqrt(r' S^-1 r) and cost of each pair, (P,) twice.

    S = H P H' + R is taken block by block: (x, y), the numbers of `config.components`, and where
    a velocity was measured (d_x, d_y) given (x, y). The cost is the distance, or,
    where the density of strays is known, the surprise -2 ln p(x, y | track): a wide track does not
    take what a sharp one explains better, and a pair less likely than a stray is none.
    """
    how = (*COMPARED[config.components], _velocity_limit(config))
    squared, surprise = pair_terms(pairs, _observed(seen), _expected(tracks), how)
    distance = np.sqrt(squared)
    if config.float32:
        distance = distance.astype(np.float32).astype(np.float64)
    if config.stray_per_m2 is None:
        return distance, distance
    unlikely = surprise > seen.surprise_limit[pairs[0]]
    return np.where(unlikely, np.inf, distance), surprise


def _velocity_limit(config: AssociationConfig) -> float:
    """What a velocity adds to d^2 at most; below 0 it is left alone altogether."""
    if not config.velocity:
        return -1.0
    if config.stray_per_m2 is not None:
        return 0.0
    return (config.velocity_limit or np.inf) ** 2


def innovation_squared(seen: Detections, tracks: Predicted, pairs: Pairs) -> F64:
    """NIS of the box, (P,): r' S^-1 r over all seven numbers, for the test of consistency."""
    how = (*COMPARED["box"], -1.0)
    squared: F64 = pair_terms(pairs, _observed(seen), _expected(tracks), how)[0]
    return squared


def _observed(seen: Detections) -> Observed:
    box = (seen.box, seen.position, seen.axial)
    return (*box, seen.velocity, seen.velocity_covariance, seen.moving, seen.no_news, seen.stray)


def _expected(tracks: Predicted) -> Expected:
    return (
        np.ascontiguousarray(tracks.mean),
        np.ascontiguousarray(tracks.planar),
        np.ascontiguousarray(tracks.axial),
    )


def centre_cost(
    seen: Detections, tracks: Predicted, pairs: Pairs, config: AssociationConfig
) -> tuple[F64, F64]:
    """Distance of the centres in metres, twice."""
    distance = centre_distance_m(seen.box[:, :2], tracks.mean[:, :2], pairs)
    return distance, distance


def box_overlap_cost(
    seen: Detections, tracks: Predicted, pairs: Pairs, config: AssociationConfig
) -> tuple[F64, F64]:
    """1 - overlap, twice; `config.metric` names the overlap."""
    # numba behind it: loaded only by those who compare overlaps
    from mottrack.trackers.association.overlap import OVERLAPS, overlap_cost

    columns = [0, 1, 2, 4, 5, 6, 3]
    cost = overlap_cost(
        seen.box[:, columns], tracks.mean[:, columns], pairs, OVERLAPS[config.metric]
    )
    return cost, cost


def heading_residual(difference_rad: F64) -> F64:
    """Difference of headings modulo pi, in [-pi/2, pi/2]: a box says little of front and rear."""
    wrapped = wrap_angle(difference_rad)
    return np.where(
        wrapped > np.pi / 2,
        wrapped - np.pi,
        np.where(wrapped < -np.pi / 2, wrapped + np.pi, wrapped),
    )


COSTS: dict[str, PairCost] = {
    "mahalanobis": mahalanobis_cost,
    "centre": centre_cost,
    "iou_bev": box_overlap_cost,
    "iou_3d": box_overlap_cost,
    "giou_bev": box_overlap_cost,
    "giou_3d": box_overlap_cost,
}
"""Distance (against the gate) and cost (for the assignment) of pairs, by metric."""
