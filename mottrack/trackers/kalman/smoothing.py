"""Rauch-Tung-Striebel smoothing (1965) of finished tracks, for labels made offline."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import ConfigError
from mottrack.core.objects import Tracks
from mottrack.core.pose import wrap_angle
from mottrack.core.sweep import seconds_between
from mottrack.geometry.angles import heading_residual
from mottrack.trackers.kalman.config import KalmanConfig, StandingConfig
from mottrack.trackers.kalman.noise import NoiseTable, process_covariance
from mottrack.trackers.kalman.state import POSE, RATE, STATE_SIZE, YAW
from mottrack.trackers.kalman.tracklets import Estimate, Tracklet, collected, tracklets_of


def smooth(steps: Sequence[Tracks], config: KalmanConfig | None = None) -> list[Tracks]:
    """Return the tracks of a finished scene, each state given all of its track's detections.

    A track is published at every step from its first detection to its last, gaps included;
    coasting after the last detection is cut off. Its score is the mean over its published rows, the
    same at every step.

    Args:
        steps: outputs of `KalmanTracker.step`, in order.
        config: that tracker's settings.

    Raises:
        ConfigError: the tracker counts in frames, whose length the smoother does not know.
    """
    motions = Motions(steps, config or KalmanConfig())
    return collected(steps, [motions.of(t.label).smoothed(t) for t in tracklets_of(steps)])


class Motions:
    """Motion models of the classes over the steps of a scene."""

    def __init__(self, steps: Sequence[Tracks], config: KalmanConfig) -> None:
        if config.time == "frames":
            raise ConfigError("smoothing needs time in seconds, not frames")
        self._stamps_ns = np.array([step.stamp_ns for step in steps], np.int64)
        self._table = NoiseTable(config.noise)
        self._config = config

    def of(self, label: str) -> Motion:
        """Return the model of a class."""
        process = self._table.process(self._table.index(np.array([label])))
        wiener = self._config.noise.form == "wiener"
        return Motion(process, self._stamps_ns, wiener, self._config.standing)


@dataclass(frozen=True)
class Motion:
    """Constant velocity of one class over the steps of a scene."""

    process: F64
    """(1, 11) process noise per second."""
    stamps_ns: I64
    """(T,) of the steps."""
    wiener: bool
    standing: StandingConfig

    def predicted(self, estimate: Estimate, step: int) -> tuple[Estimate, F64]:
        """Return the estimate carried to another step, and the transition F (11, 11).

        To an earlier step F is the inverse, and the same noise is added.
        """
        dt_s = seconds_between(int(self.stamps_ns[estimate.step]), int(self.stamps_ns[step]))
        transition = np.eye(STATE_SIZE)
        transition[POSE, RATE] = dt_s * np.eye(4)
        growth = process_covariance(self.process, np.array([abs(dt_s)]), self.wiener)[0]
        if dt_s < 0:
            growth[POSE, RATE] *= -1.0
            growth[RATE, POSE] *= -1.0
        covariance = transition @ estimate.covariance @ transition.T + growth
        mean, moving = transition @ estimate.mean, estimate.p_moving
        return Estimate(step, mean, covariance, False, 0.0, moving), transition

    def smoothed(self, tracklet: Tracklet) -> Tracklet:
        """Return the tracklet at every step of its span, each state given all its detections."""
        filled = self._with_gaps_filled(tracklet.estimates)
        return tracklet._replace(estimates=self._smoothed(filled))

    def _with_gaps_filled(self, estimates: list[Estimate]) -> list[Estimate]:
        """Return the estimates with a prediction at every step in between that has none."""
        filled = [estimates[0]]
        for following in estimates[1:]:
            for step in range(filled[-1].step + 1, following.step):
                filled.append(self.predicted(filled[-1], step)[0])
            filled.append(following)
        return filled

    def _smoothed(self, estimates: list[Estimate]) -> list[Estimate]:
        """Return every estimate given all later ones as well.

        C = P F' (F P F' + Q)^-1, x^s = x + C (x^s_next - F x), P^s = P + C (P^s_next - P_next) C'.
        Not filterpy's smoother, which subtracts headings as plain numbers: here they are compared
        modulo pi, since the tracker may have flipped the heading in between.
        """
        smoothed = [estimates[-1]]
        for estimate in reversed(estimates[:-1]):
            later = smoothed[-1]
            predicted, transition = self.predicted(estimate, later.step)
            gain = np.linalg.solve(predicted.covariance, transition @ estimate.covariance).T
            offset = later.mean - predicted.mean
            offset[YAW] = heading_residual(offset[YAW])
            mean = estimate.mean + gain @ offset
            mean[YAW] = wrap_angle(mean[YAW])
            spread = estimate.covariance + gain @ (later.covariance - predicted.covariance) @ gain.T
            moving = self._smoothed_moving(estimate, later)
            symmetric = 0.5 * (spread + spread.T)
            smoothed.append(estimate._replace(mean=mean, covariance=symmetric, p_moving=moving))
        return smoothed[::-1]

    def _smoothed_moving(self, estimate: Estimate, later: Estimate) -> float:
        """Return the probability of moving given the later step's: a chain of two states."""
        dt_s = seconds_between(*self.stamps_ns[[estimate.step, later.step]].tolist())
        start = 1.0 - math.exp(-self.standing.start_per_s * dt_s)
        stop = 1.0 - math.exp(-self.standing.stop_per_s * dt_s)
        moving = estimate.p_moving
        expected = moving * (1.0 - stop) + (1.0 - moving) * start
        if expected in (0.0, 1.0):
            return moving
        ratio, other = later.p_moving / expected, (1.0 - later.p_moving) / (1.0 - expected)
        return min(moving * ((1.0 - stop) * ratio + stop * other), 1.0)
