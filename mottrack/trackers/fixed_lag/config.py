"""Settings of the fixed-lag tracker, with their defaults."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.trackers.velocity_source.config import VelocityTestConfig


class MotionModelConfig(StrictModel):
    """The constant-acceleration model and the prior of new tracks."""

    jerk_psd_m2ps5: float = Field(
        1.0, gt=0, description="power spectral density of white jerk, per axis"
    )
    nugget_m: float = Field(0.01, gt=0, description="sigma added to position (m), velocity (m/s)")
    """Pure white jerk makes Q(0.1 s) so ill-conditioned that GTSAM's Cholesky rejects tracks."""
    birth_speed_sigma_mps: float = Field(10.0, gt=0, description="prior of velocity, per axis")
    birth_acceleration_sigma_mps2: float = Field(3.0, gt=0, description="prior of acceleration")


class RobustConfig(StrictModel):
    """Huber weights of measurements, and the windows solved again for them."""

    threshold: float = Field(2.0, ge=0, description="sigmas with quadratic loss; 0: no weights")
    flag: float = Field(3.0, ge=0, description="innovation, in sigmas, that flags a window")
    span: int = Field(9, ge=1, description="nodes for which a window stays flagged")
    """Later ones hardly change a weight."""
    iterations: int = Field(1, ge=0, le=20, description="re-weightings per window and frame")
    max_windows: int = Field(15, ge=0, description="windows solved again per frame, worst first")


class MissedMotionConfig(StrictModel):
    """Test of measured velocities against the displacement over the window."""

    p_static: float = Field(
        0.9, gt=0, le=1, description="objects that stand still; 1: velocities are always believed"
    )
    speed_sigma_mps: float = Field(10.0, gt=0, description="speed of moving objects, per axis")
    acceleration_mps2: float = Field(
        2.0, ge=0, description="sigma of the acceleration that a straight line leaves out"
    )
    position_sigma_factor: float = Field(
        1.5, ge=1, description="factor on the sigma of positions, whose errors last over frames"
    )
    extent_ratio: float = Field(
        0.5, ge=0, description="share of a change of extent by which the position may have moved"
    )
    surface_speed_mps: float = Field(
        1.0, ge=0, description="speed of a visible part along an object that stands still"
    )


class MeasurementConfig(StrictModel):
    """Noise of measurements that bring none, and a floor of measured noise."""

    position_sigma_m: float = Field(0.3, gt=0, description="of objects without a covariance")
    use_velocity: bool = Field(True, description="add the velocity factor where there is one")
    velocity_floor_mps: float = Field(
        0.5, ge=0, description="added to measured sigma, squared: errors of a flow last over frames"
    )


class FixedLagAssociationConfig(StrictModel):
    """Association of objects with tracks by the Mahalanobis distance of the position."""

    rule: Literal["one_to_one", "nearest"] = Field(
        "one_to_one", description="best assignment, or each object's nearest track (the paper)"
    )
    clutter_density_per_m2: float = Field(
        0.01, gt=0, description="density of objects that belong to no track (one_to_one)"
    )
    p_birth_velocity_outlier: float = Field(
        0.1, gt=0, le=1, description="probability that a track's first velocity was an outlier"
    )
    young_hits: int = Field(
        3, ge=0, description="tracks seen less often may have an outlier as first velocity"
    )
    gate: float = Field(4.0, gt=0, description="largest Mahalanobis distance")
    gate_m: float = Field(4.0, gt=0, description="largest distance in metres")


class FixedLagManagementConfig(StrictModel):
    """Confirmation, deletion and output of tracks."""

    min_hits: int = Field(2, ge=1, description="tracks seen less often are not published")
    max_age_s: float = Field(0.6, gt=0, le=60, description="tracks unseen for longer are deleted")
    publish_coasting: bool = Field(False, description="publish tracks not seen at this stamp")


class MergeSplitConfig(StrictModel):
    """Clusters that split or merge."""

    enabled: bool = Field(True, description="handle merges and splits of hulls")
    min_overlap: float = Field(0.5, gt=0, le=1, description="share of area that counts as inside")
    max_growth: float = Field(1.3, ge=1, description="a joined hull is at most this much larger")
    max_coast_s: float = Field(1.0, ge=0, description="merged tracks coast for at most this long")
    child_velocity_sigma_mps: float = Field(
        2.0, gt=0, description="sigma of the velocity that a split child takes from its parent"
    )


class FixedLagConfig(StrictModel):
    """All settings of `FixedLagTracker`."""

    engine: Literal["gtsam", "numpy"] = Field("gtsam", description="what eliminates the chains")
    separate_factors: bool = Field(False, description="motion, position, velocity apart (gtsam)")
    lag_s: float = Field(1.0, ge=0, le=60, description="length of the window")
    motion: MotionModelConfig = Field(default_factory=MotionModelConfig)
    robust: RobustConfig = Field(default_factory=RobustConfig)
    missed_motion: MissedMotionConfig = Field(default_factory=MissedMotionConfig)
    measurement: MeasurementConfig = Field(default_factory=MeasurementConfig)
    velocity_test: VelocityTestConfig = Field(default_factory=VelocityTestConfig)
    association: FixedLagAssociationConfig = Field(default_factory=FixedLagAssociationConfig)
    track_management: FixedLagManagementConfig = Field(default_factory=FixedLagManagementConfig)
    merge_split: MergeSplitConfig = Field(default_factory=MergeSplitConfig)
