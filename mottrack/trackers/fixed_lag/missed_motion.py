"""Missed-motion test: a measured velocity against the displacement over the window.

A flow source that finds no match for a sparse or fast cluster reports that it stands still, with
its usual covariance, and so in every frame. Such errors agree with each other, so a robust loss
about the joint estimate accepts them. The displacement over the window is independent of the flow.
With z the measured velocity, R its covariance, m the displacement's velocity, C its covariance, B
the prior of a moving object's velocity, and p_missed the source's share of missed motions
(`mottrack.core.velocity_errors`), averaged over the speeds N(m, C), the hypotheses are

    static, z correct     p_static N(z; 0, R) N(m; 0, C)
    moving, z correct     (1 - p_static) (1 - p_missed) N(z; m, R + C) N(m; 0, B + C)
    moving, z missed it   (1 - p_static) p_missed N(z; 0, R) N(m; 0, B + C)

and z loses its weight where the last is likelier than the others together. Velocities that are
wrong in another way do not last; the robust loss deals with them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, Mask
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.geometry.two_by_two import (
    density_2x2,
    determinant_2x2,
    inverse_2x2,
    log_density_2x2,
)
from mottrack.trackers.fixed_lag.config import MissedMotionConfig
from mottrack.trackers.fixed_lag.engine import History
from mottrack.trackers.velocity_source.failures import SMALLEST

_REJECTED = 1e-4
"""Weight of a rejected velocity: nearly zero, since errors that last do not average out."""
_UNKNOWN_M2PS2 = 1e6
"""Variance of the velocity of a track with one node: far above any speed, yet invertible."""
_SHORTEST_S = 1e-3
"""Lower bound of a window's length, so that a single node is no division by zero."""


class Motion(NamedTuple):
    """Velocities of N tracks as their positions alone tell them."""

    velocity_mps: F64
    """(N, 2) of tracks that move."""
    covariance_m2ps2: F64
    """(N, 2, 2)"""
    p_standing: F64
    """(N,) probability that they stand."""


class MissedMotionTest:
    """Decides which measured velocities missed the motion."""

    def __init__(self, config: MissedMotionConfig) -> None:
        self._config = config

    def weights(self, odds: F64) -> F64:
        """Return 1 where the log odds are negative, and nearly 0 elsewhere."""
        return np.where(odds > 0.0, _REJECTED, 1.0)

    def odds(self, history: History, error_model: VelocityErrorModel) -> F64:
        """Return log odds (N, D) that a measured velocity missed the motion.

        -inf where no velocity was measured, or where the source misses no motion.
        """
        p_static = self._config.p_static
        if p_static >= 1.0 or not error_model.misses_motion:
            return np.full(history.age_s.shape, -np.inf)
        mean_mps, spread = self._displacement(history)
        p_missed = _missed_share(error_model, mean_mps, spread)
        z_mps, noise = history.velocity_mps, history.velocity_covariance_m2ps2
        prior = spread + self._config.speed_sigma_mps**2 * np.eye(2)
        moves = np.log(1.0 - p_static) + log_density_2x2(mean_mps, prior)
        at_rest = log_density_2x2(z_mps, noise)
        static = np.log(p_static) + at_rest + log_density_2x2(mean_mps, spread)
        seen = np.log(1.0 - p_missed) + log_density_2x2(z_mps - mean_mps, noise + spread)
        missed = np.log(p_missed) + moves + at_rest
        odds = missed - np.logaddexp(static, seen + moves)
        return np.where(history.has_velocity, odds, -np.inf)

    def motion(self, history: History) -> Motion:
        """Return what the positions (N, D) tell of each track's velocity."""
        config = self._config
        (mean_mps, spread), prior = (
            self._displacement(history),
            config.speed_sigma_mps**2 * np.eye(2),
        )
        mean_mps, spread = mean_mps[:, 0], spread[:, 0]
        information = inverse_2x2(spread)
        posterior = inverse_2x2(information + np.eye(2) / config.speed_sigma_mps**2)
        moved = np.einsum("nij,njk,nk->ni", posterior, information, mean_mps)
        stands = config.p_static * density_2x2(mean_mps, spread)
        moves = (1.0 - config.p_static) * density_2x2(mean_mps, spread + prior)
        return Motion(moved, posterior, stands / np.maximum(stands + moves, SMALLEST))

    def _displacement(self, history: History) -> tuple[F64, F64]:
        """Return velocity (N, 1, 2) and covariance (N, 1, 2, 2) of the straight line."""
        config, positions = self._config, history.position_m
        mean_mps, covariance = displacement_velocity(
            history.there, history.age_s, positions, history.position_covariance_m2
        )
        lasted_s = history.age_s.max(axis=1, initial=0.0)
        # the line's middle and its end differ by half a window of acceleration
        bend_mps = config.acceleration_mps2 * lasted_s / 2
        growth_m = config.extent_ratio * np.ptp(history.extent_m, axis=1)
        growth_mps = growth_m / np.maximum(lasted_s, _SHORTEST_S)
        own = bend_mps**2 + growth_mps**2 + config.surface_speed_mps**2
        covariance = config.position_sigma_factor**2 * covariance + own[:, None, None] * np.eye(2)
        return mean_mps[:, None], covariance[:, None]


def _missed_share(model: VelocityErrorModel, mean_mps: F64, covariance: F64) -> F64:
    """Return the share of missed motions, averaged over velocities N(mean, covariance) (...).

    The mean of exp(-u^2 / 2 s^2) is 2 pi s^2 N(mean; 0, covariance + s^2 I).
    """
    variance = model.missed_speed_mps**2
    density = density_2x2(mean_mps, covariance + variance * np.eye(2))
    return model.p_missed_motion + model.p_missed_slow * 2.0 * np.pi * variance * density


def displacement_velocity(
    there: Mask, age_s: F64, position_m: F64, covariance_m2: F64
) -> tuple[F64, F64]:
    """Return velocity (N, 2) and covariance (N, 2, 2) of straight lines through positions.

    Weighted least squares over (N, D) nodes, eliminated block by block from the normal equations of
    (position at the newest node, velocity). A track with one node has a velocity of zero with a
    variance of 1e6.

    Args:
        there: (N, D) nodes that exist; the newest always does.
        age_s: (N, D) time before the newest node.
        position_m: (N, D, 2)
        covariance_m2: (N, D, 2, 2) of the positions.
    """
    information = np.where(there[:, :, None, None], inverse_2x2(covariance_m2), 0.0)
    pull = np.einsum("ndij,ndj->ndi", information, position_m)
    a, right = information.sum(axis=1), pull.sum(axis=1)
    b = np.einsum("nd,ndij->nij", -age_s, information)
    c = np.einsum("nd,ndij->nij", age_s**2, information)
    lever = b @ inverse_2x2(a)
    own = c - lever @ b
    moment = np.einsum("nd,ndi->ni", -age_s, pull) - np.einsum("nij,nj->ni", lever, right)
    single = determinant_2x2(own) < 1.0 / _UNKNOWN_M2PS2
    own[single] = np.eye(2) / _UNKNOWN_M2PS2
    moment[single] = 0.0
    covariance = inverse_2x2(own)
    return np.einsum("nij,nj->ni", covariance, moment), covariance
