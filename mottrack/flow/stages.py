"""The processing stages before and after a flow estimator, each switched by the configuration.

    pair = stages.before(past, current)         # ground, alignment, visibility
    raw = ...                                   # any estimator, on pair.previous and pair.current
    refined = stages.after(raw, pair)           # verification and refinement

The raw field and the refined one are both worth reporting: the second is the estimator plus
geometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I8
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.flow.registration.refine import RefineConfig, refine
from mottrack.flow.sweep_pair import (
    GroundStage,
    PastSweep,
    RecentFeatures,
    SweepFeatures,
    SweepPair,
    elapsed_seconds,
)
from mottrack.lidar.alignment import AlignmentConfig, AlignmentTarget, residual_motion
from mottrack.lidar.visibility import visibility_raster, with_returns


class AlignmentStage(AlignmentConfig):
    """Correction of the odometry between the two sweeps."""

    enabled: bool = Field(True, description="align the sweeps by their non-ground points")


class VisibilityStage(StrictModel):
    """What the previous sweep could see."""

    enabled: bool = Field(True, description="compute the visibility rasters")


class RefineStage(RefineConfig):
    """Geometric verification and refinement of moving components."""

    enabled: bool = Field(True, description="verify and refine the field")


class StagesConfig(StrictModel):
    """Settings of all stages."""

    ground: GroundStage = Field(default_factory=GroundStage)
    alignment: AlignmentStage = Field(default_factory=AlignmentStage)
    visibility: VisibilityStage = Field(default_factory=VisibilityStage)
    refine: RefineStage = Field(default_factory=RefineStage)


class Stages:
    """The stages before and after an estimator."""

    def __init__(self, config: StagesConfig | None = None, grid: BevGrid | None = None) -> None:
        """`grid` is the grid of the visibility rasters and of the fields given to `after`."""
        self.config = config or StagesConfig()
        self.grid = grid or BevGrid()
        self._recent = RecentFeatures(self.config.ground.reaching(self.grid))

    def before(self, past: Sequence[Sweep], current: Sweep) -> SweepPair:
        """Remove ground and ego motion from sweeps, each in its own ego frame.

        Args:
            past: at least one, from the oldest to the newest.
            current: the sweep to whose frame they are moved.

        Raises:
            InputError: the sweeps are not in order of time.
        """
        elapsed_seconds(past, current)
        self._recent.keep(past[0], current)
        later = self._recent.of(current)
        now, now_height_m = later.obstacles
        target = AlignmentTarget(now.xyz_m, self.config.alignment)
        moved = tuple(self._past_sweep(sweep, current, target) for sweep in past)
        newest = moved[-1]
        return SweepPair(
            past=moved,
            current=now,
            current_features=later,
            current_height_m=now_height_m,
            reach_m=self._recent.reach_m,
            current_seen=self._seen(later, now, Pose.identity()),
            previous_seen=self._seen(newest.features, newest.obstacles, newest.sweep_T_current),
        )

    def features_of(self, sweep: Sweep) -> SweepFeatures:
        """Return what is computed of one sweep alone, after a gap: the others are forgotten."""
        self._recent.keep(sweep, sweep)
        return self._recent.of(sweep)

    def _past_sweep(self, sweep: Sweep, current: Sweep, target: AlignmentTarget) -> PastSweep:
        """Return an earlier sweep in the current frame, aligned with the current one directly."""
        features = self._recent.of(sweep)
        then, height_m = features.obstacles
        sweep_T_current = sweep.world_T_ego.inverse() @ current.world_T_ego
        then = _moved(then, sweep_T_current.inverse())
        if self.config.alignment.enabled:
            correction = residual_motion(then.xyz_m, target)
            then = _moved(then, correction)
            sweep_T_current = sweep_T_current @ correction.inverse()
        return PastSweep(
            obstacles=replace(then, world_T_ego=current.world_T_ego),
            height_m=height_m,
            features=features,
            sweep_T_current=sweep_T_current,
            elapsed_s=seconds_between(sweep.stamp_ns, current.stamp_ns),
        )

    def reset(self) -> None:
        """Remove the features of earlier sweeps."""
        self._recent.clear()

    def _seen(self, features: SweepFeatures, obstacles: Sweep, sweep_T_grid: Pose) -> I8 | None:
        if not self.config.visibility.enabled:
            return None
        seen = visibility_raster(features.sweep, features.farthest_m, self.grid, sweep_T_grid)
        return with_returns(seen, obstacles.xyz_m, self.grid)

    def after(self, field: FlowField, pair: SweepPair) -> FlowField:
        """Return the field, verified and refined by geometry.

        Raises:
            InputError: the field does not lie on the grid of these stages.
        """
        if field.grid != self.grid:
            raise InputError("grid of field", field.grid, str(self.grid))
        if self.config.refine.enabled:
            field = refine(field, pair, self.config.refine)
        return field


def _moved(sweep: Sweep, frame_T_sweep: Pose) -> Sweep:
    """Return the sweep with its points and its optical centre in another frame."""
    return replace(
        sweep,
        xyz_m=_transformed(sweep.xyz_m, frame_T_sweep.rotation, frame_T_sweep.translation_m),
        origin_m=frame_T_sweep.apply(sweep.origin_m[None])[0],
    )


@compiled
def _transformed(xyz_m: F32, rotation: F64, translation_m: F64) -> F32:
    """Rotate and translate points (N, 3) in 64 bits, in one pass over them."""
    moved = np.empty((len(xyz_m), 3), np.float32)
    for i in range(len(xyz_m)):
        x, y, z = np.float64(xyz_m[i, 0]), np.float64(xyz_m[i, 1]), np.float64(xyz_m[i, 2])
        for k in range(3):
            rotated = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
            moved[i, k] = rotated + translation_m[k]
    return moved
