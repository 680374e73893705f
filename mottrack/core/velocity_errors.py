"""How often a measured velocity is wrong by more than its covariance says."""

from __future__ import annotations

from dataclasses import dataclass

from mottrack.core.errors import InputError


@dataclass(frozen=True, slots=True)
class VelocityErrorModel:
    """What a source of velocities does beside erring by its covariance.

    Raises:
        InputError: a number is negative, or the shares leave no sound velocity.
    """

    relative: float = 0.0
    """Standard deviation along the velocity as a share of it: some of the cells stood still."""
    p_missed_motion: float = 0.0
    """Velocities measured as if the object stood still: its motion was not seen."""
    p_outlier: float = 0.0
    """Velocities that are another object's, or nobody's."""

    def __post_init__(self) -> None:
        for name in ("relative", "p_missed_motion", "p_outlier"):
            if not getattr(self, name) >= 0.0:
                raise InputError(name, getattr(self, name), "at least 0")
        if self.p_missed_motion + self.p_outlier >= 1.0:
            shares = f"{self.p_missed_motion} + {self.p_outlier}"
            raise InputError("p_missed_motion + p_outlier", shares, "less than 1")


NO_OUTLIERS = VelocityErrorModel()
"""No outliers: a radar, a detector of known quality, the truth."""
FLOW_ERRORS = VelocityErrorModel(relative=0.45, p_missed_motion=0.35, p_outlier=0.1)
"""Learned or filtered flow; assumed of a source that does not state an error model."""
REGISTRATION_ERRORS = VelocityErrorModel(relative=0.6, p_missed_motion=0.02, p_outlier=0.1)
"""Registration of points (ICP): it loses few motions, but what it finds may be wrong."""
