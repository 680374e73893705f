"""Robust weights of position factors: Huber's loss, by re-solving flagged windows.

A cluster that is cut by an occlusion or joined with its neighbour jumps by metres. When it arrives
its weight comes from the innovation; later measurements then show whether it was an outlier, and
the window of a flagged track is solved again with the weights of its smoothed residuals
(iteratively reweighted least squares). Redescending losses are left out on purpose: after a bad
birth they lock onto it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.trackers.fixed_lag.engine import FixedLagEngine
from mottrack.trackers.fixed_lag.motion import F64, square_root_information


@dataclass(frozen=True)
class Huber:
    """When a position counts as an outlier and how much work a frame may spend on it."""

    threshold: float = 2.0
    """Normalised distance up to which the loss is quadratic; 0 switches robust weights off."""
    flag: float = 3.0
    """Normalised innovation from which on a window is solved again."""
    iterations: int = 3
    """Re-weightings per window and frame."""
    max_windows: int = 15
    """Windows solved again in one frame; the largest innovations go first."""

    def weights(self, distance: F64) -> F64:
        """(N,) weight `min(1, threshold / distance)` of normalised distances (N,)."""
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
            moving = [s for s in moving if np.abs(fresh[s] - current[s])[1:].max() > 1e-3]
            if not moving:
                break
            engine.reweigh(moving, [fresh[slot] for slot in moving])
            current |= {slot: fresh[slot] for slot in moving}
        return len(flagged)

    def _flagged(self, engine: FixedLagEngine, slots: list[int]) -> list[int]:
        """Tracks with a suspicious measurement that is still open to a second look."""
        worst = {}
        for slot in slots:
            nodes = engine.window(slot)[1:]
            innovation = max((node.innovation for node in nodes), default=0.0)
            if innovation > self.flag:
                worst[slot] = innovation
        ranked = sorted(worst, key=lambda slot: (-worst[slot], slot))
        return ranked[: self.max_windows]

    def _window_weights(self, engine: FixedLagEngine, slot: int) -> F64:
        """(K,) weights from the residuals of the smoothed window."""
        nodes = engine.window(slot)
        position = np.array([node.batch.position_m[node.row] for node in nodes])
        noise = np.array([node.batch.position_covariance_m2[node.row] for node in nodes])
        off = position - engine.smooth(slot).mean[:, :2]
        whitened = np.einsum("nij,nj->ni", square_root_information(noise), off)
        return self.weights(np.linalg.norm(whitened, axis=1))
