"""How the velocities of one step err, as far as it is known."""

from __future__ import annotations

from typing import NamedTuple

from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.trackers.velocity_source.failures import Failures


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

    @classmethod
    def stated(cls, model: VelocityErrorModel, unit_s: float) -> Law:
        """Return the law of a source that is believed."""
        return cls(model, Failures.of(model, unit_s), 1.0, 1.0, unit_s)
