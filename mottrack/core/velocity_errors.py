"""Outlier statistics of a velocity source: errors beyond its covariance."""

from __future__ import annotations

from dataclasses import dataclass

from mottrack.core.errors import InputError


@dataclass(frozen=True, slots=True)
class VelocityErrorModel:
    """Errors of a velocity source that its covariance does not describe.

    Raises:
        InputError: a number is negative, or the two probabilities add up to 1 or more.
    """

    relative: float = 0.0
    """Standard deviation along the velocity as a fraction of it: part of the cells was static."""
    p_missed_motion: float = 0.0
    """Probability that a moving object is measured as static."""
    p_outlier: float = 0.0
    """Probability that the velocity is another object's, or of nothing at all."""

    def __post_init__(self) -> None:
        for name in ("relative", "p_missed_motion", "p_outlier"):
            if not getattr(self, name) >= 0.0:
                raise InputError(name, getattr(self, name), "at least 0")
        if self.p_missed_motion + self.p_outlier >= 1.0:
            shares = f"{self.p_missed_motion} + {self.p_outlier}"
            raise InputError("p_missed_motion + p_outlier", shares, "less than 1")


NO_OUTLIERS = VelocityErrorModel()
"""A radar, a detector of known quality, the truth."""
FLOW_ERRORS = VelocityErrorModel(relative=0.45, p_missed_motion=0.35, p_outlier=0.1)
"""Learned or filtered flow, and the default of `FlowSourceBase`. Rounded from the max-likelihood
fit to PillarFlow in the embedded world: 0.44, 0.38, 0 to 0.08 (docs/tracker.md)."""
REGISTRATION_ERRORS = VelocityErrorModel(relative=0.6, p_missed_motion=0.02, p_outlier=0.1)
"""Registration of points (ICP): it misses few motions, but may match the wrong points. Rounded from
the fit to ICP: 0.64, 0.02, 0 to 0.08."""
