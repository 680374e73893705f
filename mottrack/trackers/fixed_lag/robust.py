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

from mottrack.trackers.fixed_lag.engine import FixedLagEngine, stacked
from mottrack.trackers.fixed_lag.motion import F64, square_root_information


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

    def refine(self, engine: FixedLagEngine, slots: list[int]) -> int:
        """Solves the flagged windows among `slots` again; returns how many."""
        if self.threshold <= 0:
            return 0
        flagged = self._flagged(engine, slots)
        current = {slot: np.array([n.weight for n in engine.window(slot)]) for slot in flagged}
        moving = flagged
        for _ in range(self.iterations):
            fresh = {slot: self._window_weights(engine, slot) for slot in moving}
            moving = [s for s in moving if np.abs(fresh[s] - current[s]).max() > 1e-3]
            if not moving:
                break
            engine.reweigh(moving, [fresh[slot] for slot in moving])
            current |= {slot: fresh[slot] for slot in moving}
        return len(flagged)

    def _flagged(self, engine: FixedLagEngine, slots: list[int]) -> list[int]:
        """Tracks with a suspicious measurement that is still open to a second look."""
        worst = {}
        for slot in slots:
            recent = engine.window(slot)[1:][-self.span :]
            innovation = max((node.surprise for node in recent), default=0.0)
            if innovation > self.flag:
                worst[slot] = innovation
        ranked = sorted(worst, key=lambda slot: (-worst[slot], slot))
        return ranked[: self.max_windows]

    def _window_weights(self, engine: FixedLagEngine, slot: int) -> F64:
        """(K, 2) weights from the residuals of the smoothed window; the oldest keeps its own."""
        nodes = list(engine.window(slot))
        data, smoothed = stacked(nodes), engine.smooth(slot).mean
        distance = np.empty((len(nodes), 2))
        distance[:, 0] = _length(data.position_covariance_m2, data.position_m - smoothed[:, :2])
        spread = np.where(
            data.has_velocity[:, None, None], data.velocity_covariance_m2ps2, np.eye(2)
        )
        distance[:, 1] = _length(spread, data.velocity_mps - smoothed[:, 2:4])
        distance[~data.has_velocity, 1] = 0.0
        weights = self.weights(distance)
        if not nodes[0].is_birth:
            weights[0] = nodes[0].weight
        return weights


def _length(covariance: F64, off: F64) -> F64:
    """(N,) normalised length of residuals (N, 2)."""
    whitened = np.einsum("nij,nj->ni", square_root_information(covariance), off)
    return np.asarray(np.hypot(whitened[:, 0], whitened[:, 1]))
