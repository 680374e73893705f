"""Robust weights of measurements: Huber's loss, by solving flagged windows again.

A cluster that is cut by an occlusion or merged with its neighbour jumps by metres, and a flow that
matched the wrong points is off by metres per second. When they arrive their weight comes from the
innovation; later measurements then show whether it was an outlier, and the window of a flagged
track is solved again with the weights of its smoothed residuals (iteratively reweighted least
squares). Redescending losses are left out on purpose: after a bad birth they lock onto it.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel
from mottrack.geometry.two_by_two import mahalanobis_2x2
from mottrack.trackers.fixed_lag.config import MissedMotionConfig, RobustConfig
from mottrack.trackers.fixed_lag.engine import Engine, Recent
from mottrack.trackers.fixed_lag.missed_motion import MissedMotionTest

_SETTLED = 0.05
"""Smaller changes of a weight are not worth solving a window again."""


class RobustWeights:
    """Huber weights, joined with the missed-motion test of velocities."""

    def __init__(self, config: RobustConfig, missed_motion: MissedMotionConfig) -> None:
        self._config = config
        self._test = MissedMotionTest(missed_motion)

    def weights(self, distance: F64) -> F64:
        """Return `min(1, threshold / distance)` for normalised distances of any shape."""
        threshold = self._config.threshold
        if threshold <= 0:
            return np.ones_like(distance)
        return threshold / np.maximum(distance, threshold)

    def refine(
        self, engine: Engine, slots: I64, error_model: VelocityErrorModel = NO_OUTLIERS
    ) -> int:
        """Solve the flagged windows among `slots` (N,) again and return how many.

        `error_model` belongs to the source that measured the velocities.
        """
        if self._config.threshold <= 0 or len(slots) == 0:
            return 0
        window = self._flagged(engine, slots, error_model)
        count = len(window.slots)
        for _ in range(self._config.iterations):
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
        """Return the worst windows with a suspicious measurement whose weight may still change."""
        window = engine.recent(slots, self._config.span + 1)
        worst = engine.innovation(window)[:, 1:].max(axis=(1, 2), initial=0.0)
        excess = worst / self._config.flag
        odds = self._test.odds(engine.history(window), error_model)
        rejected = self._test.weights(odds) < engine.weight(window)[:, :, 1] - _SETTLED
        excess = excess + np.where(rejected & window.open, 1.0 + odds, 0.0).max(axis=1)
        ranked = np.lexsort((slots, -excess))
        return window.select(ranked[excess[ranked] > 1.0][: self._config.max_windows])

    def _window_weights(
        self, engine: Engine, recent: Recent, error_model: VelocityErrorModel
    ) -> F64:
        """Return weights (N, D, 2) from smoothed residuals and the missed-motion test."""
        history, smoothed = engine.history(recent), engine.smoothed(recent)
        off_m = history.position_m - smoothed[:, :, :2]
        off_mps = history.velocity_mps - smoothed[:, :, 2:4]
        position = self.weights(mahalanobis_2x2(off_m, history.position_covariance_m2))
        velocity = self.weights(mahalanobis_2x2(off_mps, history.velocity_covariance_m2ps2))
        odds = self._test.odds(history, error_model)
        velocity = np.minimum(velocity, self._test.weights(odds))
        return np.stack([position, np.where(history.has_velocity, velocity, 1.0)], axis=2)
