"""Robust weights of measurements: Huber's loss, by re-solving flagged windows.

A cluster that is cut by an occlusion or joined with its neighbour jumps by metres, and a flow that
matched the wrong points is off by metres per second. When they arrive
their weight comes from the innovation; later measurements then show whether it was an outlier, and
the window of a flagged track is solved again with the weights of its smoothed residuals
(iteratively reweighted least squares). Redescending losses are left out on purpose: after a bad
birth they lock onto it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.trackers.fixed_lag.engine import FixedLagEngine, Recent
from mottrack.trackers.fixed_lag.motion import F64, planar_root_information
from mottrack.trackers.fixed_lag.store import I64


@dataclass(frozen=True)
class Huber:
    """When a position counts as an outlier and how much work a frame may spend on it."""

    threshold: float = 2.0
    """Normalised distance up to which the loss is quadratic; 0 switches robust weights off."""
    flag: float = 3.0
    """Normalised innovation from which on a window is solved again."""
    span: int = 4
    """Nodes for which a window stays flagged: later ones hardly change the verdict."""
    iterations: int = 3
    """Re-weightings per window and frame."""
    max_windows: int = 15
    """Windows solved again in one frame; the largest innovations go first."""

    def weights(self, distance: F64) -> F64:
        """Weights `min(1, threshold / distance)` of normalised distances of any shape."""
        if self.threshold <= 0:
            return np.ones_like(distance)
        return self.threshold / np.maximum(distance, self.threshold)

    def refine(self, engine: FixedLagEngine, slots: I64) -> int:
        """Solves the flagged windows among `slots` (N,) again; returns how many."""
        flagged = engine.recent(self._flagged(engine, slots), self.span + 1)
        count = len(flagged.slots)
        if count == 0:
            return 0
        for _ in range(self.iterations):
            fresh, old = self._window_weights(engine, flagged), engine.weight(flagged)
            moved = (np.abs(fresh - old).max(axis=2) > 1e-3) & flagged.open
            moving = moved.any(axis=1)
            if not moving.any():
                break
            flagged = Recent(*(array[moving] for array in flagged))
            engine.reweigh(flagged, fresh[moving], moved[moving].argmax(axis=1))
        return count

    def _flagged(self, engine: FixedLagEngine, slots: I64) -> I64:
        """Tracks with a suspicious measurement that is still open to a second look."""
        if self.threshold <= 0 or len(slots) == 0:
            return slots[:0]
        worst = engine.innovation(engine.recent(slots, self.span)).max(axis=(1, 2))
        ranked = np.lexsort((slots, -worst))
        chosen = ranked[worst[ranked] > self.flag][: self.max_windows]
        return np.asarray(slots[chosen])

    def _window_weights(self, engine: FixedLagEngine, recent: Recent) -> F64:
        """(N, D, 2) weights from the residuals of the smoothed nodes."""
        data, smoothed = engine.residuals(recent)
        distance = np.zeros((*recent.there.shape, 2))
        off_m, off_mps = data.position_m - smoothed[:, :2], data.velocity_mps - smoothed[:, 2:4]
        unseen = ~data.has_velocity
        spread = np.where(unseen[:, None, None], np.eye(2), data.velocity_covariance_m2ps2)
        velocity = np.where(unseen, 0.0, _length(spread, off_mps))
        position = _length(data.position_covariance_m2, off_m)
        distance[recent.there] = np.column_stack([position, velocity])
        return self.weights(distance)


def _length(covariance: F64, off: F64) -> F64:
    """(N,) normalised length of residuals (N, 2)."""
    whitened = np.einsum("nij,nj->ni", planar_root_information(covariance), off)
    return np.asarray(np.hypot(whitened[:, 0], whitened[:, 1]))
