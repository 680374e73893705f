"""Association of one step's detections with the predicted tracks."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.trackers.association import ASSIGNMENTS, candidate_pairs
from mottrack.trackers.kalman.config import AssociationConfig, KalmanConfig
from mottrack.trackers.kalman.detections import Detections
from mottrack.trackers.kalman.pair_cost import COSTS, largest_offset_m
from mottrack.trackers.kalman.predicted import Predicted

Pairs = tuple[I64, I64]


def match(
    seen: Detections, tracks: Predicted, config: KalmanConfig, labels: list[str]
) -> tuple[I64, I64]:
    """Matched tracks and detections, two index arrays sorted by track.

    Detections below the second stage's score are kept back, and offered afterwards to the tracks
    that found none.
    """
    second = config.second_stage
    gates = gates_by_class(config.association, labels)
    if not second.enabled:
        return _sorted(_stage(seen, tracks, config.association, gates))
    strong = seen.score >= second.score
    sure, unsure = np.flatnonzero(strong), np.flatnonzero(~strong)
    rows, columns = _stage(seen.select(sure), tracks, config.association, gates)
    left = others(len(tracks.mean), rows)
    gates = gates_by_class(second.association, labels)
    more = _stage(seen.select(unsure), tracks.select(left), second.association, gates)
    return _sorted((np.append(rows, left[more[0]]), np.append(sure[columns], unsure[more[1]])))


def others(count: int, chosen: I64) -> I64:
    """The numbers below `count` that are not among the chosen, sorted."""
    free = np.ones(count, bool)
    free[chosen] = False
    return np.flatnonzero(free)


def gates_by_class(config: AssociationConfig, labels: list[str]) -> F64:
    """The gate of each class, (C,)."""
    return np.array([config.gates.get(label, config.gate) for label in labels])


def _stage(seen: Detections, tracks: Predicted, config: AssociationConfig, gates: F64) -> Pairs:
    """Tracks and detections that one round of gate, cost and assignment joins."""
    gate = gates[tracks.label]
    reach = np.minimum(largest_offset_m(seen, tracks, gate, config), config.max_distance_m)
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
