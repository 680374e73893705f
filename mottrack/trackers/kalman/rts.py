"""The Rauch-Tung-Striebel smoother (1965) of one track, over the tracker's motion models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.pose import wrap_angle
from mottrack.trackers.kalman.motion_models import MOTION_MODELS
from mottrack.trackers.kalman.noise_model import process_covariance
from mottrack.trackers.kalman.pair_cost import heading_residual
from mottrack.trackers.kalman.state import YAW


@dataclass(frozen=True, slots=True)
class Estimate:
    """State of a track at a step: mean (D,), covariance (D, D)."""

    step: int
    mean: F64
    covariance: F64
    observed: bool


@dataclass(frozen=True, slots=True)
class Motion:
    """How one track moves: the model's name, its process noise (13,), the form of that noise."""

    model: str
    process: F64
    wiener: bool

    def predict(self, mean: F64, covariance: F64, dt_s: float) -> tuple[F64, F64, F64]:
        """Mean and covariance after dt_s, and the Jacobian (D, D) of the step."""
        dt = np.array([dt_s])
        after, jacobian = MOTION_MODELS[self.model](mean[None], dt)
        growth = process_covariance(self.process[None], dt, self.model, len(mean), self.wiener)
        return after[0], jacobian[0] @ covariance @ jacobian[0].T + growth[0], jacobian[0]


def fill_gaps(estimates: Sequence[Estimate], stamps_ns: I64, motion: Motion) -> list[Estimate]:
    """The estimates with a prediction at every step in between that has none."""
    filled = [estimates[0]]
    for following in estimates[1:]:
        for step in range(filled[-1].step + 1, following.step):
            last = filled[-1]
            dt_s = float(stamps_ns[step] - stamps_ns[last.step]) * 1e-9
            mean, covariance, _ = motion.predict(last.mean, last.covariance, dt_s)
            filled.append(Estimate(step, mean, covariance, observed=False))
        filled.append(following)
    return filled


def rts(estimates: Sequence[Estimate], stamps_ns: I64, motion: Motion) -> list[Estimate]:
    """Every estimate given all later ones as well.

    C = P F' (F P F' + Q)^-1; x^s = x + C (x^s_next - f(x)); P^s = P + C (P^s_next - P_next|k) C'.
    A heading that the tracker turned round in between is compared modulo pi.
    """
    smoothed = [estimates[-1]]
    for estimate in reversed(estimates[:-1]):
        later = smoothed[-1]
        dt_s = float(stamps_ns[later.step] - stamps_ns[estimate.step]) * 1e-9
        mean, spread, jacobian = motion.predict(estimate.mean, estimate.covariance, dt_s)
        gain = np.linalg.solve(spread, jacobian @ estimate.covariance).T
        offset = later.mean - mean
        offset[YAW] = heading_residual(offset[YAW])
        state = estimate.mean + gain @ offset
        state[YAW] = wrap_angle(state[YAW])
        covariance = estimate.covariance + gain @ (later.covariance - spread) @ gain.T
        smoothed.append(
            Estimate(estimate.step, state, 0.5 * (covariance + covariance.T), estimate.observed)
        )
    return smoothed[::-1]
