"""Settings of the fixed-lag tracker, with their defaults."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.trackers.fixed_lag.missed_motion import Witness
from mottrack.trackers.fixed_lag.motion import MotionNoise
from mottrack.trackers.fixed_lag.robust import Huber


class MotionConfig(StrictModel):
    """The constant-acceleration model and the prior of new tracks."""

    jerk_psd_m2ps5: float = Field(1.0, gt=0, description="power spectral density of white jerk")
    nugget_m: float = Field(0.01, gt=0, description="sigma added to position (m), velocity (m/s)")
    birth_speed_sigma_mps: float = Field(10.0, gt=0, description="prior of velocity, per axis")
    birth_acceleration_sigma_mps2: float = Field(3.0, gt=0, description="prior of acceleration")

    def noise(self) -> MotionNoise:
        """The same numbers for the engines."""
        return MotionNoise(**self.model_dump())


class RobustConfig(StrictModel):
    """Huber weights of positions, and the windows solved again for them."""

    threshold: float = Field(2.0, ge=0, description="sigmas with quadratic loss; 0: no weights")
    flag: float = Field(3.0, ge=0, description="innovation, in sigmas, that flags a window")
    span: int = Field(9, ge=1, description="nodes for which a window stays flagged")
    iterations: int = Field(1, ge=0, le=20, description="re-weightings per window and frame")
    max_windows: int = Field(15, ge=0, description="windows solved again per frame")
    rest_share: float = Field(
        0.9, gt=0, le=1, description="objects that stand still; 1: velocities are always believed"
    )
    growth: float = Field(
        0.5, ge=0, description="share of a change of extent by which the position may have moved"
    )
    creep_mps: float = Field(
        1.0, ge=0, description="speed at which a visible part may slide along a standing object"
    )
    acceleration_mps2: float = Field(2.0, ge=0, description="what a straight line leaves out")
    slide: float = Field(
        1.5, ge=1, description="factor on the sigma of positions, whose errors last over frames"
    )

    def huber(self) -> Huber:
        """The same numbers for the engines."""
        judge = ("rest_share", "growth", "acceleration_mps2", "slide", "creep_mps")
        witness = Witness(**{name: getattr(self, name) for name in judge})
        own = self.model_dump(exclude=set(judge))
        return Huber(**own, witness=witness)


class MeasurementConfig(StrictModel):
    """Noise of measurements that bring none, and how far measured noise is trusted."""

    position_sigma_m: float = Field(0.3, gt=0, description="of objects without a covariance")
    use_velocity: bool = Field(True, description="add the velocity factor where there is one")
    velocity_floor_mps: float = Field(
        0.5, ge=0, description="added to measured sigma, squared: errors of a flow last over frames"
    )


class AssociationConfig(StrictModel):
    """Which object belongs to which track: Mahalanobis distance of the predicted position."""

    rule: Literal["one_to_one", "nearest"] = Field(
        "one_to_one", description="best assignment, or each object's nearest track (the paper)"
    )
    stray_per_m2: float = Field(
        0.01, gt=0, description="density of objects that belong to no track (one_to_one)"
    )
    flow_doubt: float = Field(
        0.1, gt=0, le=1, description="probability that the flow at birth was quite wrong"
    )
    young_hits: int = Field(3, ge=0, description="tracks seen less often may doubt their flow")
    gate: float = Field(4.0, gt=0, description="largest Mahalanobis distance")
    gate_m: float = Field(4.0, gt=0, description="largest distance in metres")


class TrackManagementConfig(StrictModel):
    """Birth and death of tracks, and what is published."""

    min_hits: int = Field(2, ge=1, description="tracks seen less often are not published")
    max_age_s: float = Field(0.6, gt=0, le=60, description="unseen for longer, a track dies")
    publish_coasting: bool = Field(False, description="publish tracks not seen at this stamp")


class MergeSplitConfig(StrictModel):
    """Clusters that fall apart or run together."""

    enabled: bool = Field(True, description="handle merges and splits of hulls")
    inside_share: float = Field(0.5, gt=0, le=1, description="share of area that counts as inside")
    growth: float = Field(1.3, ge=1, description="a joined hull is at most this much larger")
    hold_s: float = Field(1.0, ge=0, description="merged tracks coast for at most this long")
    heir_sigma_mps: float = Field(2.0, gt=0, description="velocity sigma of a piece's new track")


class FixedLagConfig(StrictModel):
    """All settings of `FixedLagTracker`."""

    engine: Literal["gtsam", "numpy"] = Field("gtsam", description="what eliminates the chains")
    separate_factors: bool = Field(False, description="motion, position, velocity apart (gtsam)")
    lag_s: float = Field(1.0, ge=0, le=60, description="length of the window")
    motion: MotionConfig = Field(default_factory=MotionConfig)
    robust: RobustConfig = Field(default_factory=RobustConfig)
    measurement: MeasurementConfig = Field(default_factory=MeasurementConfig)
    association: AssociationConfig = Field(default_factory=AssociationConfig)
    life: TrackManagementConfig = Field(default_factory=TrackManagementConfig)
    merge_split: MergeSplitConfig = Field(default_factory=MergeSplitConfig)
