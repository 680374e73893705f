"""Settings of the Kalman tracker and their presets."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from mottrack.config import StrictModel
from mottrack.core.velocity_errors import PROBABILITIES
from mottrack.trackers.kalman.presets import PRESETS, merged
from mottrack.trackers.kalman.track_management import TrackManagementConfig
from mottrack.trackers.velocity_source.config import VelocityTestConfig

Variance = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]


class ClassNoise(StrictModel):
    """Noise of one class: diagonal variances in SI units (per frame where `time` is frames)."""

    observation: tuple[Positive, ...] = Field(
        min_length=7, max_length=7, description="R: variances of observed x, y, z, yaw, l, w, h"
    )
    initial: tuple[Variance, ...] = Field(
        min_length=11, max_length=11, description="P0: the same seven, then d_x, d_y, d_z, d_yaw"
    )
    process: tuple[Variance, ...] = Field(
        min_length=11, max_length=11, description="Q per unit of time, in the order of P0"
    )
    longitudinal_ratio: float = Field(
        1.0, ge=1.0, description="standard deviation of x, y along the heading over that across it"
    )
    lateral_ratio: float = Field(
        1.0, gt=0, le=1, description="speed of a new track across its heading over that along it"
    )
    slip_rad: float = Field(
        0.15, gt=0, description="standard deviation of a mover's heading about its course"
    )


class NoiseConfig(StrictModel):
    """Source of the noise parameters."""

    table: str = Field("default", description="built-in table: default or chiu2020-megvii")
    form: Literal["wiener", "diagonal"] = Field(
        "wiener", description="wiener: white acceleration over real time; diagonal: as published"
    )
    classes: dict[str, ClassNoise] = Field(
        default_factory=dict, description="noise by class, in place of the table's"
    )


class VelocityConfig(StrictModel):
    """The velocity observation (d_x, d_y) with its covariance R_d (paper, section IV-D)."""

    use: bool = Field(True, description="observe velocities where they were measured")
    birth: Literal["update", "replace"] = Field(
        "update", description="initial velocity: update P0 by the measurement, or replace P0 by it"
    )
    covariance: tuple[float, float, float] | None = Field(
        None, description="R_d as (xx, xy, yy) in (m/s)^2 for every measurement; none: its own"
    )
    noise: Literal["measured", "class"] = Field(
        "measured", description="R_d: each measurement's own, or that of its source by class"
    )
    class_variance: dict[str, Positive] = Field(
        default_factory=dict, description="R_d of one axis by class in (m/s)^2, for noise: class"
    )
    floor_mps: float = Field(0.3, gt=0, description="standard deviation added in quadrature")
    relative: float | None = Field(
        None, ge=0, description="share of the velocity added along it; none: the source's"
    )
    p_missed_motion: float | None = Field(
        None, ge=0, lt=1, description="moving objects measured at rest; none: the source's"
    )
    p_missed_slow: float | None = Field(
        None, ge=0, lt=1, description="what slow motion adds to that; none: the source's"
    )
    p_outlier: float | None = Field(
        None, ge=0, lt=1, description="velocities of another object; none: the source's"
    )
    persistence: float | None = Field(
        None, ge=0, lt=1, description="correlation of successive errors; none: the source's"
    )
    test: VelocityTestConfig = Field(default_factory=VelocityTestConfig)

    @model_validator(mode="after")
    def _check_probabilities(self) -> Self:
        given = {name: getattr(self, name) or 0.0 for name in PROBABILITIES}
        if sum(given.values()) >= 1.0:
            raise ValueError(
                f"{' + '.join(given)} is {' + '.join(map(str, given.values()))}, "
                "expected less than 1: some velocities are correct"
            )
        return self

    @model_validator(mode="after")
    def _check_covariance(self) -> Self:
        if self.covariance is not None:
            xx, xy, yy = self.covariance
            if not (xx > 0 and yy > 0 and xy * xy < xx * yy):
                raise ValueError(
                    f"covariance is {self.covariance}, expected xx, xy, yy positive definite"
                )
        return self


# Shares of standing objects (under .5 m/s) among the true boxes of the ten scenes of nuScenes
# v1.0-mini: they say how streets are, not how a detector or a flow source errs.
STANDING_SHARES = {
    "car": 0.8,
    "truck": 0.7,
    "bus": 0.2,
    "trailer": 0.8,
    "motorcycle": 0.8,
    "bicycle": 0.4,
    "cyclist": 0.2,
    "pedestrian": 0.25,
}


class StandingConfig(StrictModel):
    """The hypothesis that a track stands (`trackers.kalman.standing`)."""

    use: bool = Field(True, description="weigh standing still against moving")
    prior: dict[str, Annotated[float, Field(ge=0, lt=1)]] = Field(
        default_factory=lambda: dict(STANDING_SHARES),
        description="share of objects that stand, by class",
    )
    other: float = Field(0.5, ge=0, lt=1, description="the same of classes that are not listed")
    start_per_s: float = Field(
        0.03, ge=0, description="rate at which standing objects start: one in half a minute"
    )
    stop_per_s: float = Field(
        0.1, ge=0, description="rate at which objects near rest stop: one in ten seconds"
    )
    rest_mps: float = Field(
        0.3, gt=0, description="near rest is a velocity within this of zero (standard deviation)"
    )


class HeadingConfig(StrictModel):
    """Front and rear of a track, and its heading by motion (`trackers.kalman.heading`)."""

    p_turned: float = Field(
        0.05, gt=0, lt=0.5, description="detections turned by pi: mean before any was seen"
    )
    prior_detections: float = Field(
        20.0, gt=0, description="weight of that mean, in detections of a class"
    )
    switch_per_s: float = Field(
        0.01, ge=0, description="rate at which a track comes to be turned: it took over another"
    )
    p_backwards: float = Field(0.01, gt=0, lt=0.5, description="share of motion that is backwards")
    correlation_s: float = Field(
        0.3, gt=0, description="time after which a track's velocity is a new estimate"
    )


class AssociationConfig(StrictModel):
    """Association of detections with tracks."""

    metric: Literal["mahalanobis", "centre", "iou_bev", "iou_3d", "giou_bev", "giou_3d"] = Field(
        "mahalanobis", description="cost of a pair; overlaps cost 1 - overlap"
    )
    components: Literal["box", "xyz", "xy"] = Field(
        "box", description="what Mahalanobis compares: all seven numbers, x y z, or x y"
    )
    clutter_density_per_m2: float | None = Field(
        None,
        gt=0,
        description="density of new and false detections; a pair must be likelier than clutter",
    )
    class_clutter_density_per_m2: dict[str, Positive] = Field(
        default_factory=dict,
        description="that density by class, where `clutter_density_per_m2` is given",
    )
    estimate_clutter: bool = Field(
        False, description="estimate that density while tracking; the settings are its prior"
    )
    clutter_prior_frames: float = Field(
        5.0, gt=0, description="weight of the prior, in frames of the area that detections span"
    )
    clutter_concentration: float = Field(
        3.0, gt=0, description="density around an object over the average: objects stand in groups"
    )
    score_weight: float = Field(
        0.0, ge=0, description="of the score's log-odds in the likelihood of a pair"
    )
    estimate_score_weight: bool = Field(
        False, description="estimate that weight by class while tracking; the setting is its prior"
    )
    score_prior_detections: float = Field(
        20.0, gt=0, description="weight of the prior, in detections that no track took"
    )
    velocity: bool = Field(True, description="Mahalanobis compares measured velocities as well")
    new_at_rest: float = Field(
        0.15,
        ge=0,
        lt=1,
        description="share of detections without a track whose velocity is that of rest",
    )
    velocity_limit: float | None = Field(
        None, gt=0, description="a velocity adds at most this many sigma: flow has gross errors"
    )
    method: Literal["greedy", "hungarian", "mutual_nearest"] = Field(
        "greedy", description="assignment of the gated pairs"
    )
    gate: float = Field(11.0, gt=0, description="largest cost of a pair (sigma, metres, 1 - IoU)")
    gates: dict[str, Positive] = Field(default_factory=dict, description="gate by class")
    max_distance_m: float = Field(
        1e3, gt=0, description="largest distance of the centres along x and along y"
    )
    class_aware: bool = Field(True, description="match within a class only")
    float32: bool = Field(False, description="round costs as the published tracker does")


class SecondStageConfig(StrictModel):
    """Second association stage for detections of a low score (ByteTrack)."""

    enabled: bool = Field(False, description="match weak detections to tracks left over")
    score: float = Field(0.3, description="detections below it wait for the second stage")
    association: AssociationConfig = Field(default_factory=AssociationConfig)

    @model_validator(mode="after")
    def _check_scores(self) -> Self:
        for name in ("score_weight", "estimate_score_weight"):
            if getattr(self.association, name):
                raise ValueError(f"association.{name} is a setting of the first stage alone")
        return self


class OfflineConfig(StrictModel):
    """What a finished scene's tracks get beyond smoothing (`trackers.kalman.offline`)."""

    enabled: bool = Field(False, description="for labels: smooth, and apply the settings below")
    link: bool = Field(True, description="join tracklets of one object across gaps")
    vote_sizes: bool = Field(True, description="one size a track, the weighted median of all")
    remove_ghosts: bool = Field(
        True, description="drop tracks that are more likely false, by length and scores"
    )


class NmsConfig(StrictModel):
    """Non-maximum suppression before tracking."""

    enabled: bool = Field(False, description="drop boxes that overlap a stronger one")
    iou: float = Field(0.1, ge=0, le=1, description="BeV IoU above which the weaker one is dropped")
    class_aware: bool = Field(True, description="suppress within a class only")
    min_score: float | None = Field(None, description="drop weaker detections altogether")


class KalmanConfig(StrictModel):
    """Settings of `KalmanTracker`; `preset` fills in whatever is not given."""

    preset: str = Field("default", description="default, stanford_iprl_tri or pillarflow")
    time: Literal["seconds", "frames"] = Field("seconds", description="unit of time of the filter")
    frame_s: float = Field(0.5, gt=0, description="length of the first step where time is frames")
    engine: Literal["block", "filterpy"] = Field(
        "block", description="block: closed form, compiled; filterpy: slow readable reference"
    )
    yaw: Literal["estimated", "published"] = Field(
        "estimated",
        description="estimated: headings by detections and motion (`heading`); published: a track "
        "is turned by each detection that contradicts it",
    )
    smooth: bool = Field(
        False, description="smooth finished tracks backwards and fill their gaps: for labels"
    )
    offline: OfflineConfig = Field(default_factory=OfflineConfig)
    diagnose: bool = Field(
        False, description="keep the NIS of each step in `tracker.nis` and `tracker.innovations`"
    )
    drop_unknown: bool = Field(False, description="drop classes without noise of their own")
    noise: NoiseConfig = Field(default_factory=NoiseConfig)
    velocity: VelocityConfig = Field(default_factory=VelocityConfig)
    standing: StandingConfig = Field(default_factory=StandingConfig)
    heading: HeadingConfig = Field(default_factory=HeadingConfig)
    association: AssociationConfig = Field(default_factory=AssociationConfig)
    second_stage: SecondStageConfig = Field(default_factory=SecondStageConfig)
    nms: NmsConfig = Field(default_factory=NmsConfig)
    track_management: TrackManagementConfig = Field(default_factory=TrackManagementConfig)

    @model_validator(mode="after")
    def _check_smoothing(self) -> Self:
        if (self.smooth or self.offline.enabled) and self.time == "frames":
            name = "smooth" if self.smooth else "offline"
            raise ValueError(f"{name} needs time in seconds, not frames")
        return self

    @model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        preset = given.get("preset", "default")
        if preset not in PRESETS:
            raise ValueError(f"preset is {preset!r}, expected one of {', '.join(PRESETS)}")
        return merged(PRESETS[preset], given)
