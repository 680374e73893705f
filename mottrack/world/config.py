"""Settings of the embedded world."""

from __future__ import annotations

from pydantic import Field

from mottrack.config import StrictModel


class DensityConfig(StrictModel):
    """How busy the scenes are; 1 is an ordinary day."""

    vehicles: float = Field(1.0, gt=0.05, le=4.0, description="factor on moving vehicles")
    pedestrians: float = Field(1.0, gt=0.05, le=6.0, description="factor on people on foot")
    parked: float = Field(1.0, ge=0.0, le=1.3, description="factor on vehicles at the kerb")
    unknown: float = Field(1.0, ge=0.0, le=10.0, description="factor on animals, balls, debris")


class PoseErrorConfig(StrictModel):
    """Errors of the odometry."""

    jitter_m: float = Field(0.008, ge=0.0, le=1.0, description="from sweep to sweep, each axis")
    jitter_deg: float = Field(0.03, ge=0.0, le=5.0, description="from sweep to sweep, heading")
    drift_m: float = Field(0.04, ge=0.0, le=5.0, description="slow, bounded")
    drift_deg: float = Field(0.05, ge=0.0, le=5.0, description="slow, bounded, heading")


class DetectorConfig(StrictModel):
    """The detector model; 1 is a good detector of 2020."""

    recall: float = Field(1.0, ge=0.0, le=1.1, description="factor on the recall of every class")
    noise: float = Field(1.0, ge=0.0, le=10.0, description="factor on box noise")
    false_positives: float = Field(1.0, ge=0.0, le=20.0, description="factor on their number")
    flips: float = Field(0.03, ge=0.0, le=1.0, description="share of flipped headings")
    max_range_m: float = Field(65.0, gt=0.0, le=200.0, description="no detection beyond")
