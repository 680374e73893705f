"""How often a measured velocity is wrong by more than its covariance says."""

from __future__ import annotations

from dataclasses import dataclass

from mottrack.core.errors import InputError


@dataclass(frozen=True, slots=True)
class VelocityFaults:
    """What a source of velocities does beside erring by its covariance.

    Raises:
        InputError: a number is negative, or the shares leave no sound velocity.
    """

    relative: float = 0.0
    """Standard deviation along the velocity as a share of it: some of the cells stood still."""
    lost_share: float = 0.0
    """Velocities measured as if the object stood still: its motion was not seen."""
    gross_share: float = 0.0
    """Velocities that are another object's, or nobody's."""

    def __post_init__(self) -> None:
        for name in ("relative", "lost_share", "gross_share"):
            if not getattr(self, name) >= 0.0:
                raise InputError(name, getattr(self, name), "at least 0")
        if self.lost_share + self.gross_share >= 1.0:
            shares = f"{self.lost_share} + {self.gross_share}"
            raise InputError("lost_share + gross_share", shares, "less than 1")


SOUND = VelocityFaults()
"""No faults: a radar, a detector of known quality, the truth."""
FLOW_FAULTS = VelocityFaults(relative=0.45, lost_share=0.35, gross_share=0.1)
"""Learned or filtered flow; assumed of a source that does not state its faults."""
REGISTRATION_FAULTS = VelocityFaults(relative=0.6, lost_share=0.02, gross_share=0.1)
"""Registration of points (ICP): it loses few motions, but what it finds may be wrong."""
