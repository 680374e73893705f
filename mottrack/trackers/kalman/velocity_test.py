"""How a source of velocities errs, estimated from the positions of tracks while it is used.

A source states a covariance, and an error model if it was calibrated. Whether they hold is seen
from tracks that are known without it: `PositionsAlone` keeps up a state N(d, P) of every track, and
the probability q that it stands, from positions only. A velocity v with covariance R is a draw from

    (1 - o) N(v; 0, s R) + o N(v; 0, R + G)                             of a standing object
    (1 - m - o) N(v; g d, g^2 P + s R) + m N(v; 0, s R) + o N(v; 0, R + G)      of a moving one

with an outlier share o and a scale s for each of the two. The shares m of missed motions and o, and
the variance G of outliers, are estimated by expectation maximisation, one step a frame, with the
error model as prior (weight `prior_velocities`). The scales take steps along the gradient of the
log-likelihood over the Fisher information so far; they are never below 1. The gain g, the share
of the speed that the source reads, is a linear regression of v on d, weighed against g = 1 by the
ratio of the marginal likelihoods. All evidence fades with `memory_s`. A velocity is divided by g,
and its covariance is multiplied by s / g^2.
"""

from __future__ import annotations

import math

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.concerns import Concern
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.observations import Matched, Observation
from mottrack.trackers.kalman.positions_alone import PositionsAlone, Tracked
from mottrack.trackers.kalman.standing import Failures
from mottrack.trackers.kalman.velocity_evidence import (
    GAIN_SPREAD,
    Before,
    Evidence,
    Known,
    judge,
)
from mottrack.trackers.kalman.velocity_law import Law

LEAST_SHARE = 1e-4
"""Prior share of failures that a source does not have: what never happens is never learned."""
OUTLIERS = 5.0
"""Weight of the stated spread of outliers, in outliers: without calibration it is a guess."""
P_GAIN = 0.1
"""Prior probability that a source reads all speeds too low or too high by a common factor."""
LEAST_GAIN = 0.05
"""A velocity is divided by the gain; of less than a twentieth of the speed nothing can be told."""
TOLD_WEIGHT = 0.5
"""A user is told of a source whose velocities count for less than half of what they state."""


class NoTest:
    """Believes every source: the presets that were published, and trackers without velocities."""

    def law(self, model: VelocityErrorModel, unit_s: float) -> Law:
        """Return how the velocities of this step err."""
        return Law.stated(model, unit_s)

    def start(self, tracks: Tracked) -> None:
        """Begin at the first measured velocity, with all tracks."""

    def predict(self, elapsed_s: F64, process: F64, unit_s: float) -> None:
        """Advance all tracks, as the bank is."""

    def append(self, tracks: Tracked) -> None:
        """Add new tracks, none of whose numbers come from a velocity."""

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""

    def observe(self, matched: Matched, position: Observation) -> None:
        """Correct matched tracks by positions."""

    def judge(self, rows: I64, velocity: Observation, law: Law) -> None:
        """Learn from the velocities (n,) of tracks, as `law` has scaled them."""

    def concern(self) -> Concern | None:
        """Return a warning if the velocities of the source were given little weight."""
        return None


class VelocityTest(NoTest):
    """Estimates how a source errs; see the module."""

    def __init__(self, config: KalmanConfig) -> None:
        self._config = config.velocity.test
        self._alone = PositionsAlone(config)
        self._evidence = Evidence(*(np.zeros(n) for n in (2, 2, 2, 2, 3, 2, 2)))
        self._kept = 1.0
        self._started, self._count = False, 0
        self._last = Law.stated(NO_OUTLIERS, 1.0)

    def law(self, model: VelocityErrorModel, unit_s: float) -> Law:
        """Return how the velocities of this step err."""
        if not self._started:
            return Law.stated(model, unit_s)
        weight = self._weight(model)
        standing_all, standing_wild = self._evidence.standing.tolist()
        moving_all, moving_lost, moving_wild = self._evidence.moving.tolist()
        number, squares = self._evidence.outliers.tolist()
        missed = _share(model.p_missed_motion, weight, moving_all, moving_lost)
        moving = _share(model.p_outlier, weight, moving_all, moving_wild)
        standing = _share(model.p_outlier, weight, standing_all, standing_wild)
        variance = OUTLIERS * (model.outlier_sigma_mps * unit_s) ** 2 + squares
        # what is left of the slow motions that are seen: the shares stay below 1 together
        left = (1.0 - missed - moving) / (1.0 - model.p_missed_motion - model.p_outlier)
        rest, scale = np.exp(self._evidence.log_scale).tolist()
        failures = Failures(
            missed,
            model.p_missed_slow * left,
            model.missed_speed_mps * unit_s,
            moving,
            variance / (OUTLIERS + number),
            standing,
            rest / scale,
        )
        self._last = Law(model, failures, self._gain(weight), scale, unit_s)
        return self._last

    def start(self, tracks: Tracked) -> None:
        """Begin at the first measured velocity, with all tracks."""
        if not self._started:
            self._started = True
            self._alone.append(tracks)

    def predict(self, elapsed_s: F64, process: F64, unit_s: float) -> None:
        """Advance all tracks, as the bank is, and let the evidence fade."""
        if not self._started:
            return
        self._alone.predict(elapsed_s, process, unit_s)
        self._kept *= math.exp(-float(elapsed_s.max(initial=0.0)) / self._config.memory_s)

    def append(self, tracks: Tracked) -> None:
        """Add new tracks, none of whose numbers come from a velocity."""
        if self._started:
            self._alone.append(tracks)

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        if self._started:
            self._alone.keep(mask)

    def observe(self, matched: Matched, position: Observation) -> None:
        """Correct matched tracks by positions."""
        if self._started:
            self._alone.observe(matched, position)

    def judge(self, rows: I64, velocity: Observation, law: Law) -> None:
        """Learn from the velocities (n,) of tracks, as `law` has scaled them."""
        self._count += len(rows)
        known = Known(*self._alone.filters, self._alone.p_standing)
        before = Before(law.failures, law.gain, self._weight(law.model), self._kept)
        judge(self._evidence, rows, velocity, known, before)
        self._kept = 1.0

    def concern(self) -> Concern | None:
        """Return a warning if the velocities of the source were given little weight."""
        law, stated = self._last, self._last.model
        found = law.failures
        correct = 1.0 - found.p_missed - found.p_outlier
        correct /= 1.0 - stated.p_missed_motion - stated.p_outlier
        weight = correct * law.gain**2 / law.scale
        if not self._count or weight >= TOLD_WEIGHT:
            return None
        text = (
            f"they count for {weight:.0%} of what they state: errors "
            f"{law.scale**0.5 / law.gain:.1f} times as large, {found.p_missed:.0%} of motions "
            f"missed ({stated.p_missed_motion:.0%} stated), {found.p_outlier:.0%} outliers "
            f"({stated.p_outlier:.0%} stated), speeds read as {law.gain:.2f} of the true ones"
        )
        kind = "velocities that disagree with the positions of the tracks, weighed down"
        return Concern(kind, self._count, text)

    def _weight(self, model: VelocityErrorModel) -> float:
        """Return the weight of what the source states, in velocities."""
        calibrated = model.misses_motion or model.p_outlier > 0.0
        config = self._config
        return config.prior_velocities if calibrated else config.uncalibrated_velocities

    def _gain(self, weight: float) -> float:
        """Return the posterior mean of the gain: 1, or about N(1, GAIN_SPREAD^2 / weight)."""
        slope, information = self._evidence.gain.tolist()
        prior = weight / GAIN_SPREAD**2
        apart = slope / (prior + information)
        log_odds = 0.5 * slope * apart - 0.5 * math.log1p(information / prior)
        p_gain = P_GAIN / (P_GAIN + (1.0 - P_GAIN) * math.exp(-log_odds))
        return max(float(1.0 + p_gain * apart), LEAST_GAIN)


def _share(stated: float, weight: float, total: float, failed: float) -> float:
    """Return the posterior mean of a share that was stated with a weight."""
    return (weight * max(stated, LEAST_SHARE) + failed) / (weight + total)


def make_test(config: KalmanConfig) -> NoTest:
    """Return the test that a configuration asks for."""
    velocity = config.velocity
    return VelocityTest(config) if velocity.use and velocity.test.use else NoTest()
