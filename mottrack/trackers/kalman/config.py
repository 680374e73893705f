"""Settings of the Kalman tracker. Every default says its unit; presets live in `presets`."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mottrack.config import StrictModel
from mottrack.core.arrays import I64, Mask
from mottrack.trackers.kalman.lifecycle import TrackManagementConfig
from mottrack.trackers.kalman.presets import PRESETS

Motion = Literal["cv", "ca", "ctrv", "bicycle", "imm"]
Variance = tuple[Annotated[float, Field(ge=0)], ...]
Positive = Annotated[float, Field(gt=0)]


class ClassNoise(StrictModel):
    """Noise of one class: diagonal variances in SI units (per frame where `time` is frames)."""

    observation: tuple[Positive, ...] = Field(
        min_length=7, max_length=7, description="R: variances of observed x, y, z, yaw, l, w, h"
    )
    initial: Variance = Field(
        min_length=11, max_length=11, description="P0: the same seven, then d_x, d_y, d_z, d_yaw"
    )
    process: Variance = Field(
        min_length=11, max_length=11, description="Q per unit of time, in the order of P0"
    )
    along_ratio: float = Field(
        1.0, ge=1.0, description="standard deviation of x, y along the heading over that across it"
    )
    across_ratio: float = Field(
        1.0, gt=0, le=1, description="speed of a new track across its heading over that along it"
    )
    initial_acceleration: float = Field(4.0, gt=0, description="P0 of a_x, a_y in (m/s^2)^2")
    jerk: float = Field(1.0, gt=0, description="Q of a_x, a_y in (m/s^2)^2 per s")


class NoiseConfig(StrictModel):
    """Where the noise comes from."""

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
        "update", description="a new track weighs the velocity against P0, or takes it as it is"
    )
    covariance: tuple[float, float, float] | None = Field(
        None, description="R_d as (xx, xy, yy) in (m/s)^2 for every measurement; none: its own"
    )
    floor_mps: float = Field(0.3, gt=0, description="standard deviation added in quadrature")
    relative: float | None = Field(
        None, ge=0, description="and along the velocity this share of it; none: as its source says"
    )
    p_missed_motion: float | None = Field(
        None, ge=0, lt=1, description="measured as if at rest; none: as its source says"
    )
    p_outlier: float | None = Field(
        None, ge=0, lt=1, description="another object's velocities; none: as their source says"
    )
    rest_prior: float = Field(
        0.05, ge=0, lt=1, description="probability that a track stands, before it was seen to"
    )
    gross_mps: float = Field(5.0, gt=0, description="spread of those about standing still")

    @model_validator(mode="after")
    def _some_are_sound(self) -> Self:
        if (self.p_missed_motion or 0.0) + (self.p_outlier or 0.0) >= 1.0:
            raise ValueError(
                f"p_missed_motion + p_outlier is {self.p_missed_motion} + {self.p_outlier}, "
                "expected less than 1: some velocities are sound"
            )
        return self

    @model_validator(mode="after")
    def _covariance_is_one(self) -> Self:
        if self.covariance is not None:
            xx, xy, yy = self.covariance
            if not (xx > 0 and yy > 0 and xy * xy < xx * yy):
                raise ValueError(
                    f"covariance is {self.covariance}, expected xx, xy, yy positive definite"
                )
        return self


class AssociationConfig(StrictModel):
    """Which detection belongs to which track."""

    metric: Literal["mahalanobis", "centre", "iou_bev", "iou_3d", "giou_bev", "giou_3d"] = Field(
        "mahalanobis", description="cost of a pair; overlaps cost 1 - overlap"
    )
    components: Literal["box", "position", "planar"] = Field(
        "box", description="what Mahalanobis compares: all seven, x y z, or x y"
    )
    stray_per_m2: float | None = Field(
        None,
        gt=0,
        description="density of new and false detections; a pair must be likelier than a stray",
    )
    strays_per_m2: dict[str, Positive] = Field(
        default_factory=dict, description="that density by class, where `stray_per_m2` is given"
    )
    velocity: bool = Field(True, description="Mahalanobis compares measured velocities as well")
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
    """A second look at detections whose score was too low to start a track."""

    enabled: bool = Field(False, description="match weak detections to tracks left over")
    score: float = Field(0.3, description="detections below it wait for the second stage")
    association: AssociationConfig = Field(default_factory=AssociationConfig)


class NmsConfig(StrictModel):
    """Non-maximum suppression before tracking."""

    enabled: bool = Field(False, description="drop boxes that overlap a stronger one")
    iou: float = Field(0.1, ge=0, le=1, description="BeV IoU above which the weaker one goes")
    class_aware: bool = Field(True, description="suppress within a class only")
    min_score: float | None = Field(None, description="drop weaker detections altogether")


class MotionConfig(StrictModel):
    """Motion model by class; `imm` follows several at once and weighs them."""

    default: Motion = Field("cv", description="motion of classes not listed")
    classes: dict[str, Motion] = Field(default_factory=dict, description="motion by class")
    imm: tuple[Literal["cv", "ca", "ctrv", "bicycle"], ...] = Field(
        ("cv", "ca", "ctrv"), min_length=2, description="the models that imm mixes"
    )
    switch_per_s: float = Field(0.2, gt=0, description="how often objects change their model")

    def asked(self) -> tuple[str, ...]:
        """The different motions asked for, sorted; indices of tracks' motions refer to it."""
        return tuple(sorted({self.default, *self.classes.values()}))

    def models(self) -> tuple[str, ...]:
        """Every single model needed, sorted."""
        asked = set(self.asked())
        return tuple(sorted((asked - {"imm"}) | (set(self.imm) if "imm" in asked else set())))

    def mixes(self) -> bool:
        """Whether any class follows several models at once."""
        return "imm" in self.asked()

    def choices(self) -> Mask:
        """Which models each of `asked` may follow, (asked, models)."""
        allowed = [self.imm if motion == "imm" else (motion,) for motion in self.asked()]
        return np.array([[model in some for model in self.models()] for some in allowed])

    def index(self, labels: list[str]) -> I64:
        """Position in `asked` of the motion of each class (C,)."""
        asked = self.asked()
        return np.array([asked.index(self.classes.get(c, self.default)) for c in labels], np.int64)


class KalmanConfig(StrictModel):
    """Settings of `KalmanTracker`; `preset` fills in whatever is not given."""

    preset: str = Field("default", description="default, stanford_iprl_tri or pillarflow")
    time: Literal["seconds", "frames"] = Field("seconds", description="unit of time of the filter")
    frame_s: float = Field(0.5, gt=0, description="length of the first step where time is frames")
    engine: Literal["auto", "block", "dense", "filterpy"] = Field(
        "auto", description="auto: the closed block form where the motion models allow it"
    )
    yaw: Literal["vote", "published"] = Field(
        "vote", description="how opposite headings are told apart (both compare modulo pi)"
    )
    smooth: bool = Field(
        False, description="retrace tracks when the scene is over, gaps filled: for labels"
    )
    diagnose: bool = Field(False, description="keep the NIS of each step in `tracker.nis`")
    drop_unknown: bool = Field(False, description="drop classes without noise of their own")
    motion: MotionConfig = Field(default_factory=MotionConfig)
    noise: NoiseConfig = Field(default_factory=NoiseConfig)
    velocity: VelocityConfig = Field(default_factory=VelocityConfig)
    association: AssociationConfig = Field(default_factory=AssociationConfig)
    second_stage: SecondStageConfig = Field(default_factory=SecondStageConfig)
    nms: NmsConfig = Field(default_factory=NmsConfig)
    life: TrackManagementConfig = Field(default_factory=TrackManagementConfig)

    @model_validator(mode="after")
    def _can_smooth(self) -> Self:
        if self.smooth and (self.time == "frames" or self.motion.mixes()):
            raise ValueError("smooth needs time in seconds and single motion models, no imm")
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


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """The nested mapping `base` with `changes` on top of it."""
    result = dict(base)
    for key, value in changes.items():
        if isinstance(value, StrictModel):
            value = value.model_dump(exclude_unset=True)
        old = result.get(key)
        both = isinstance(old, dict) and isinstance(value, dict)
        result[key] = merged(old, value) if both else value  # type: ignore[arg-type]
    return result
