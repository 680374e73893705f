"""How the velocities of one step err, as far as it is known."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from mottrack.core.arrays import F64
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.trackers.velocity_source.failures import Failures

LEAST_SHARE = 1e-4
"""Prior share of failures that a source does not have: what never happens is never learned."""


class Law(NamedTuple):
    """How the velocities of a step err."""

    model: VelocityErrorModel
    """As the source and the settings state it."""
    failures: Failures
    gain: float
    """Share of the speed that is measured."""
    scale: float
    """Factor on the stated covariance."""
    unit_s: float
    """Length of the tracker's unit of time."""

    @property
    def error_model(self) -> VelocityErrorModel:
        """The source's model, with the shares that were found.

        One that misses no motion as it is stated is told of those beyond the prior alone.
        """
        found = self.failures
        unstated = 0.0 if self.model.misses_motion else LEAST_SHARE
        return replace(
            self.model,
            p_missed_motion=max(found.p_missed - unstated, 0.0),
            p_missed_slow=found.p_slow,
            p_outlier=found.p_outlier,
        )

    def factor(self, p_standing: F64) -> F64:
        """Return the factor (n,) on stated covariances of objects that may stand."""
        return self.scale * (1.0 - p_standing + p_standing * self.failures.rest_scale)

    @classmethod
    def stated(cls, model: VelocityErrorModel, unit_s: float) -> Law:
        """Return the law of a source that is believed."""
        return cls(model, Failures.of(model, unit_s), 1.0, 1.0, unit_s)
