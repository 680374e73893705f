"""Association of one step's detections with the predicted tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.trackers.association import ASSIGNMENTS, candidate_pairs
from mottrack.trackers.kalman.config import AssociationConfig, KalmanConfig
from mottrack.trackers.kalman.detections import Detections
from mottrack.trackers.kalman.pair_cost import COSTS, largest_offset_m

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Pairs = tuple[I64, I64]


@dataclass(frozen=True, slots=True)
class Predicted:
    """What association reads of N predicted tracks."""

    mean: F64
    """(N, D) states."""
    planar: F64
    """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
    axial: F64
    """(N, 5) variances of z, yaw, l, w, h."""
    label: I64
    """(N,) index of the class."""

    def select(self, index: NDArray[Any]) -> Predicted:
        """The rows that a mask or an index picks."""
        return Predicted(*(getattr(self, name)[index] for name in self.__slots__))


def match(
    seen: Detections, tracks: Predicted, config: KalmanConfig, labels: list[str]
) -> tuple[I64, I64]:
    """Matched tracks and detections, two index arrays sorted by track.

    Detections below the second stage's score are kept back, and offered afterwards to the tracks
    that found none.
    """
    second = config.second_stage
    everyone = np.arange(len(tracks.mean))
    strong = seen.score >= second.score if second.enabled else np.ones(len(seen), bool)
    gates = gates_by_class(config.association, labels)
    first = _stage(seen, np.flatnonzero(strong), (tracks, everyone), config.association, gates)
    if not second.enabled:
        return _sorted(first)
    left = np.setdiff1d(everyone, first[0])
    gates = gates_by_class(second.association, labels)
    more = _stage(seen, np.flatnonzero(~strong), (tracks, left), second.association, gates)
    return _sorted((np.append(first[0], more[0]), np.append(first[1], more[1])))


def gates_by_class(config: AssociationConfig, labels: list[str]) -> F64:
    """The gate of each class, (C,)."""
    return np.array([config.gates.get(label, config.gate) for label in labels])


def _stage(
    seen: Detections,
    columns: I64,
    offered: tuple[Predicted, I64],
    config: AssociationConfig,
    gates: F64,
) -> Pairs:
    """One round of gate, cost and assignment between some detections and some tracks."""
    some, tracks, rows = seen.select(columns), offered[0].select(offered[1]), offered[1]
    gate = gates[tracks.label]
    reach = np.minimum(largest_offset_m(some, tracks, gate, config), config.max_distance_m)
    groups = (some.label, tracks.label) if config.class_aware else None
    pairs = candidate_pairs(some.box[:, :2], tracks.mean[:, :2], reach, groups)
    distance, cost = COSTS[config.metric](some, tracks, pairs, config)
    inside = distance <= gate[pairs[1]]
    pairs = (pairs[0][inside], pairs[1][inside])
    chosen = ASSIGNMENTS[config.method](cost[inside], pairs)
    return rows[pairs[1][chosen]], columns[pairs[0][chosen]]


def _sorted(matched: Pairs) -> Pairs:
    order = np.argsort(matched[0])
    return matched[0][order], matched[1][order]
