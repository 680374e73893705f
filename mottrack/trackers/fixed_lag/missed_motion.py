"""What positions alone say of a velocity: the witness against a flow that missed a motion.

A flow source that finds no match for a sparse or fast cluster reports that it stands still, as sure
as ever, and so in every frame. Such errors agree with each other, so a robust loss about the joint
estimate believes them. The displacement over the window is independent of the flow. With z the
measured velocity, R its covariance, m the displacement's velocity, C its covariance, B the prior of
a moving object's velocity, and the share of motions that the source loses
(`mottrack.core.velocity_errors`), the hypotheses are

    it stands, and z says so            rest N(z; 0, R) N(m; 0, C)
    it moves, and z says so             (1 - rest) (1 - lost) N(z; m, R + C) N(m; 0, B + C)
    it moves, and z missed the motion   (1 - rest) lost N(z; 0, R) N(m; 0, B + C)

and z loses its weight where the last is likelier than the others. Velocities that are wrong in
another way do not last; the robust loss deals with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, Mask
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.geometry.two_by_two import determinant_2x2, inverse_2x2, quadratic_2x2
from mottrack.trackers.fixed_lag.engine import History

_REJECTED = 1e-4
"""Weight of a velocity that is not believed: next to none, errors that last do not average out."""


@dataclass(frozen=True)
class Witness:
    """When a measured velocity is not believed."""

    rest_share: float = 0.9
    """Share of all objects that stand still; 1: every velocity is believed."""
    speed_sigma_mps: float = 10.0
    """Standard deviation of the velocity of moving objects, per axis."""
    acceleration_mps2: float = 2.0
    """Standard deviation of the acceleration that the straight line leaves out."""
    slide: float = 1.5
    """Factor on the standard deviation of positions: their errors last over frames as well."""
    growth: float = 0.5
    """Share of a change of extent by which the position may have moved."""
    creep_mps: float = 1.0
    """Speed at which a visible part may slide along an object that stands."""

    def weights(self, odds: F64) -> F64:
        """1 where the log odds are negative, and next to nothing elsewhere."""
        return np.where(odds > 0.0, _REJECTED, 1.0)

    def odds(self, history: History, error_model: VelocityErrorModel) -> F64:
        """(N, D) log odds that a measured velocity missed the motion.

        -inf where no velocity was measured, or where the source loses no motion.
        """
        if self.rest_share >= 1.0 or error_model.p_missed_motion <= 0.0:
            return np.full(history.age_s.shape, -np.inf)
        mean_mps, spread = self._displacement(history)
        z_mps, noise = history.velocity_mps, history.velocity_covariance_m2ps2
        prior = spread + self.speed_sigma_mps**2 * np.eye(2)
        moves = np.log(1.0 - self.rest_share) + _log_normal(mean_mps, prior)
        at_rest = _log_normal(z_mps, noise)
        rest = np.log(self.rest_share) + at_rest + _log_normal(mean_mps, spread)
        seen = np.log(1.0 - error_model.p_missed_motion) + _log_normal(
            z_mps - mean_mps, noise + spread
        )
        lost = np.log(error_model.p_missed_motion) + moves + at_rest
        odds = lost - np.logaddexp(rest, seen + moves)
        return np.where(history.has_velocity, odds, -np.inf)

    def _displacement(self, history: History) -> tuple[F64, F64]:
        """Velocity (N, D, 2) and covariance (N, D, 2, 2) of the straight line, for every node."""
        mean_mps, covariance = displacement_velocity(
            history.there,
            history.age_s,
            history.position_m,
            history.position_covariance_m2,
        )
        # the line's middle and its end differ by half a window of acceleration
        bend = self.acceleration_mps2 * history.age_s.max(axis=1, initial=0.0) / 2
        lasted_s = np.maximum(history.age_s.max(axis=1, initial=0.0), 1e-3)
        grown = self.growth * np.ptp(history.extent_m, axis=1) / lasted_s
        own = (bend**2 + grown**2 + self.creep_mps**2)[:, None, None] * np.eye(2)
        covariance = self.slide**2 * covariance + own
        shape = history.velocity_mps.shape
        return (
            np.broadcast_to(mean_mps[:, None], shape),
            np.broadcast_to(covariance[:, None], (*shape, 2)),
        )


def _log_normal(off: F64, covariance: F64) -> F64:
    """(N, D) logarithm of N(off; 0, covariance) for (N, D, 2) and (N, D, 2, 2)."""
    flat = covariance.reshape(-1, 2, 2)
    squared = quadratic_2x2(inverse_2x2(flat), off.reshape(-1, 2))
    value = -0.5 * (squared + np.log(determinant_2x2(flat))) - np.log(2 * np.pi)
    return np.asarray(value.reshape(off.shape[:-1]))


@compiled
def displacement_velocity(
    there: Mask, age_s: F64, position_m: F64, covariance_m2: F64
) -> tuple[F64, F64]:
    """Velocity (N, 2) and its covariance (N, 2, 2) of straight lines through the positions.

    Weighted least squares over (N, D) nodes with the positions' own covariances. A track with one
    node has a velocity of zero with a covariance of 1e6.
    """
    count = len(there)
    velocity, covariance = np.zeros((count, 2)), np.zeros((count, 2, 2))
    for n in range(count):
        # normal equations of (x, y at the newest node, velocity): blocks of 2 x 2
        normal, right = np.zeros((4, 4)), np.zeros(4)
        for k in range(there.shape[1]):
            if there[n, k]:
                _add(normal, right, (-age_s[n, k], position_m[n, k], covariance_m2[n, k]))
        lever = _product(normal[2:, :2], _inverse(normal[:2, :2]))
        own = normal[2:, 2:] - _product(lever, normal[:2, 2:])
        if own[0, 0] * own[1, 1] - own[0, 1] * own[1, 0] < 1e-6:
            covariance[n] = 1e6 * np.eye(2)
            continue
        covariance[n] = _inverse(own)
        for i in range(2):
            moment = right[2 + i] - lever[i, 0] * right[0] - lever[i, 1] * right[1]
            velocity[n] += covariance[n, :, i] * moment
    return velocity, covariance


@compiled
def _add(normal: F64, right: F64, node: tuple[float, F64, F64]) -> None:
    """Adds the equations of one position."""
    time_s, position_m, covariance_m2 = node
    information = _inverse(covariance_m2)
    for i in range(2):
        pull = information[i, 0] * position_m[0] + information[i, 1] * position_m[1]
        right[i] += pull
        right[2 + i] += time_s * pull
        for j in range(2):
            normal[i, j] += information[i, j]
            normal[i, 2 + j] += time_s * information[i, j]
            normal[2 + i, j] += time_s * information[i, j]
            normal[2 + i, 2 + j] += time_s * time_s * information[i, j]


@compiled
def _inverse(matrix: F64) -> F64:
    inverse = np.empty((2, 2))
    scale = 1.0 / (matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0])
    inverse[0, 0], inverse[1, 1] = matrix[1, 1] * scale, matrix[0, 0] * scale
    inverse[0, 1], inverse[1, 0] = -matrix[0, 1] * scale, -matrix[1, 0] * scale
    return inverse


@compiled
def _product(one: F64, other: F64) -> F64:
    product = np.zeros((2, 2))
    for i in range(2):
        for j in range(2):
            product[i, j] = one[i, 0] * other[0, j] + one[i, 1] * other[1, j]
    return product
