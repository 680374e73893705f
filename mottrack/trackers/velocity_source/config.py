"""Settings of the estimate of how a source of velocities errs."""

from __future__ import annotations

from pydantic import Field

from mottrack.config import StrictModel


class VelocityTestConfig(StrictModel):
    """The estimate of how the source errs, from the positions of tracks (`velocity_test`)."""

    use: bool = Field(
        True, description="weigh velocities by how they agree with the positions of the tracks"
    )
    prior_velocities: float = Field(
        30.0, gt=0, description="weight of a calibrated source's error model, in velocities"
    )
    uncalibrated_velocities: float = Field(
        10.0, gt=0, description="weight of the stated covariance of a source that has none"
    )
    memory_s: float = Field(
        60.0, gt=0, description="time after which a velocity counts e times less"
    )
