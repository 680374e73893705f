"""How a source of velocities errs, estimated from the positions of tracks while it is used.

A source states a covariance, and an error model if it was calibrated. Whether they hold is seen
from tracks that are known without it: of each, positions alone tell a velocity N(d, P) and the
probability q that it stands. A velocity v with covariance R is a draw from

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

from mottrack.core.arrays import F64
from mottrack.core.concerns import Concern
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel
from mottrack.trackers.velocity_source.config import VelocityTestConfig
from mottrack.trackers.velocity_source.evidence import (
    GAIN,
    GAIN_SPREAD,
    LOG_SCALE,
    MOVING,
    OUTLIERS,
    STANDING,
    no_evidence,
)
from mottrack.trackers.velocity_source.failures import Failures
from mottrack.trackers.velocity_source.law import LEAST_SHARE, Law

LEAST_OUTLIERS = 5.0
"""Weight of the stated spread of outliers, in outliers: without calibration it is a guess."""
P_GAIN = 0.1
"""Prior probability that a source reads all speeds too low or too high by a common factor."""
LEAST_GAIN = 0.05
"""A velocity is divided by the gain; of less than a twentieth of the speed nothing can be told."""
TOLD_WEIGHT = 0.5
"""A user is told of a source whose velocities count for less than half of what they state."""


class SourceTest:
    """The estimate; a tracker adds to `evidence` with `judge` of `evidence`."""

    def __init__(self, config: VelocityTestConfig) -> None:
        self._config = config
        self.evidence = no_evidence()
        """See `velocity_source.evidence`."""
        self.count = 0
        """Velocities that were judged."""
        self._last = Law.stated(NO_OUTLIERS, 1.0)

    def law(self, model: VelocityErrorModel, unit_s: float) -> Law:
        """Return how the velocities of this step err; `unit_s` is the tracker's unit of time."""
        weight, known = self._weight(model), self.evidence.tolist()
        standing_all, standing_wild = known[STANDING : STANDING + 2]
        moving_all, moving_lost, moving_wild = known[MOVING : MOVING + 3]
        number, squares = known[OUTLIERS : OUTLIERS + 2]
        missed = _share(model.p_missed_motion, weight, moving_all, moving_lost)
        moving = _share(model.p_outlier, weight, moving_all, moving_wild)
        standing = _share(model.p_outlier, weight, standing_all, standing_wild)
        variance = LEAST_OUTLIERS * (model.outlier_sigma_mps * unit_s) ** 2 + squares
        # what is left of the slow motions that are seen: the shares stay below 1 together
        left = (1.0 - missed - moving) / (1.0 - model.p_missed_motion - model.p_outlier)
        rest, scale = math.exp(known[LOG_SCALE]), math.exp(known[LOG_SCALE + 1])
        failures = Failures(
            missed,
            model.p_missed_slow * left,
            model.missed_speed_mps * unit_s,
            moving,
            variance / (LEAST_OUTLIERS + number),
            standing,
            rest / scale,
        )
        gain = _gain(weight, known[GAIN], known[GAIN + 1])
        self._last = Law(model, failures, gain, scale, unit_s)
        return self._last

    def numbers(self, law: Law) -> F64:
        """Return (10,) what is known before a step, as `evidence.believed` reads it."""
        weight = self._weight(law.model)
        return np.array((*law.failures, law.gain, weight, self._config.memory_s))

    def concern(self) -> Concern | None:
        """Return a warning if the velocities of the source were given little weight."""
        law, stated = self._last, self._last.model
        found = law.failures
        correct = 1.0 - found.p_missed - found.p_outlier
        correct /= 1.0 - stated.p_missed_motion - stated.p_outlier
        weight = correct * law.gain**2 / law.scale
        if not self.count or weight >= TOLD_WEIGHT:
            return None
        text = (
            f"they count for {weight:.0%} of what they state: errors "
            f"{law.scale**0.5 / law.gain:.1f} times as large, {found.p_missed:.0%} of motions "
            f"missed ({stated.p_missed_motion:.0%} stated), {found.p_outlier:.0%} outliers "
            f"({stated.p_outlier:.0%} stated), speeds read as {law.gain:.2f} of the true ones"
        )
        kind = "velocities that disagree with the positions of the tracks, weighed down"
        return Concern(kind, self.count, text)

    def _weight(self, model: VelocityErrorModel) -> float:
        """Return the weight of what the source states, in velocities."""
        calibrated = model.misses_motion or model.p_outlier > 0.0
        config = self._config
        return config.prior_velocities if calibrated else config.uncalibrated_velocities


def _gain(weight: float, slope: float, information: float) -> float:
    """Return the posterior mean of the gain: 1, or about N(1, GAIN_SPREAD^2 / weight)."""
    prior = weight / GAIN_SPREAD**2
    apart = slope / (prior + information)
    log_odds = 0.5 * slope * apart - 0.5 * math.log1p(information / prior)
    p_gain = P_GAIN / (P_GAIN + (1.0 - P_GAIN) * math.exp(-log_odds))
    return max(float(1.0 + p_gain * apart), LEAST_GAIN)


def _share(stated: float, weight: float, total: float, failed: float) -> float:
    """Return the posterior mean of a share that was stated with a weight."""
    return (weight * max(stated, LEAST_SHARE) + failed) / (weight + total)
