"""Robust weights of measurements: Huber's loss, by re-solving flagged windows.

A cluster that is cut by an occlusion or joined with its neighbour jumps by metres, and a flow that
matched the wrong points is off by metres per second. When they arrive
their weight comes from the innovation; later measurements then show whether it was an outlier, and
the window of a flagged track is solved again with the weights of its smoothed residuals
(iteratively reweighted least squares). Redescending losses are left out on purpose: after a bad
birth they lock onto it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel
from mottrack.geometry.two_by_two import inverse_2x2, quadratic_2x2
from mottrack.trackers.fixed_lag.engine import Engine, Recent
from mottrack.trackers.fixed_lag.missed_motion import Witness

_SETTLED = 0.05
"""Smaller changes of a weight are not worth solving a window again."""


@dataclass(frozen=True)
class Huber:
    """When a position counts as an outlier and how much work a frame may spend on it."""

    threshold: float = 2.0
    """Normalised distance up to which the loss is quadratic; 0 switches robust weights off."""
    flag: float = 3.0
    """Normalised innovation from which on a window is solved again."""
    span: int = 9
    """Nodes for which a window stays flagged: later ones hardly change the verdict."""
    iterations: int = 1
    """Re-weightings per window and frame."""
    max_windows: int = 15
    """Windows solved again in one frame; the largest innovations go first."""
    witness: Witness = field(default_factory=Witness)
    """Judges measured velocities by the displacement."""

    def weights(self, distance: F64) -> F64:
        """Weights `min(1, threshold / distance)` of normalised distances of any shape."""
        if self.threshold <= 0:
            return np.ones_like(distance)
        return self.threshold / np.maximum(distance, self.threshold)

    def refine(
        self, engine: Engine, slots: I64, error_model: VelocityErrorModel = NO_OUTLIERS
    ) -> int:
        """Solves the flagged windows among `slots` (N,) again; returns how many.

        `faults` are those of the source that measured the velocities.
        """
        if self.threshold <= 0 or len(slots) == 0:
            return 0
        window = self._flagged(engine, slots, error_model)
        count = len(window.slots)
        for _ in range(self.iterations):
            if len(window.slots) == 0:
                break
            fresh = self._window_weights(engine, window, error_model)
            old = engine.weight(window)
            moved = (np.abs(fresh - old).max(axis=2) > _SETTLED) & window.open
            moving = moved.any(axis=1)
            window = window.select(moving)
            engine.reweigh(window, fresh[moving], moved[moving].argmax(axis=1))
        return count

    def _flagged(self, engine: Engine, slots: I64, error_model: VelocityErrorModel) -> Recent:
        """Windows with a suspicious measurement that is still open to a second look."""
        window = engine.recent(slots, self.span + 1)
        worst = engine.innovation(window)[:, 1:].max(axis=(1, 2), initial=0.0)
        excess = worst / self.flag
        odds = self.witness.odds(engine.history(window), error_model)
        blamed = self.witness.weights(odds) < engine.weight(window)[:, :, 1] - _SETTLED
        excess = excess + np.where(blamed & window.open, 1.0 + odds, 0.0).max(axis=1)
        ranked = np.lexsort((slots, -excess))
        return window.select(ranked[excess[ranked] > 1.0][: self.max_windows])

    def _window_weights(
        self, engine: Engine, recent: Recent, error_model: VelocityErrorModel
    ) -> F64:
        """(N, D, 2) weights from the residuals of the smoothed nodes, and from the witness."""
        history, smoothed = engine.history(recent), engine.smoothed(recent)
        off_m = history.position_m - smoothed[:, :, :2]
        off_mps = history.velocity_mps - smoothed[:, :, 2:4]
        position = self.weights(_length(history.position_covariance_m2, off_m))
        velocity = self.weights(_length(history.velocity_covariance_m2ps2, off_mps))
        odds = self.witness.odds(history, error_model)
        velocity = np.minimum(velocity, self.witness.weights(odds))
        return np.stack([position, np.where(history.has_velocity, velocity, 1.0)], axis=2)


def _length(covariance: F64, off: F64) -> F64:
    """(N, D) normalised length of residuals (N, D, 2)."""
    flat = inverse_2x2(covariance.reshape(-1, 2, 2))
    return np.asarray(np.sqrt(quadratic_2x2(flat, off.reshape(-1, 2)))).reshape(off.shape[:2])
