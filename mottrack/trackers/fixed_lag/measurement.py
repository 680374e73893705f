"""From objects to measurements with noise, each row judged on its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.objects import Objects
from mottrack.trackers.fixed_lag.config import MeasurementConfig
from mottrack.trackers.fixed_lag.nodes import definite


@dataclass(frozen=True, eq=False)
class Measured:
    """Position and velocity noise of M objects."""

    position_covariance_m2: F64
    """(M, 2, 2)."""
    velocity_mps: F64
    """(M, 2)."""
    velocity_covariance_m2ps2: F64
    """(M, 2, 2)."""
    has_velocity: Mask
    """(M,)."""
    usable: Mask
    """(M,) objects whose position can be a measurement."""

    def with_velocity(self, rows: I64, mean: F64, covariance: F64) -> Measured:
        """The same with velocities put in for some rows."""
        velocity, spread = self.velocity_mps.copy(), self.velocity_covariance_m2ps2.copy()
        has = self.has_velocity.copy()
        velocity[rows], spread[rows], has[rows] = mean, covariance, True
        return Measured(self.position_covariance_m2, velocity, spread, has, self.usable)


def measured(objects: Objects, config: MeasurementConfig) -> Measured:
    """Measurements of M objects; what an object does not bring comes from the settings."""
    count = len(objects)
    position = objects.position_covariance_m2
    if position is None:
        position = np.tile(config.position_sigma_m**2 * np.eye(2), (count, 1, 1))
    velocity, spread = np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1))
    has = np.zeros(count, np.bool_)
    if objects.velocity is not None and config.use_velocity:
        floor = config.velocity_floor_mps**2 * np.eye(2)
        has = objects.velocity.valid.copy()
        velocity[has] = objects.velocity.mean_mps[has]
        spread[has] = objects.velocity.covariance_m2ps2[has] + floor
        has &= definite(spread)
    return Measured(np.array(position), velocity, spread, has, definite(position))
