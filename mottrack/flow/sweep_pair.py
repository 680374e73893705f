"""The input of a flow estimator: obstacle points of sweeps, and what is computed of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I8, I64, Mask
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep, has_jumped, seconds_between
from mottrack.lidar.ground import GroundConfig, find_ground
from mottrack.lidar.point_grid import first_in_voxel
from mottrack.lidar.visibility import RangeImage, build_range_image, farthest_returns

LONGEST_SEARCH_S = 10.0
"""Of a longer time nothing is measured: a car may be 400 m away, and the work of a search grows
with the square of that."""


class GroundStage(StrictModel):
    """Which points are obstacles, by their height above the ground and their range.

    Both ground removal and the obstacle points extend to `find.reach_m`, or to the side of the
    grid if that is farther.
    """

    enabled: bool = Field(True, description="remove the ground; off keeps every point in range")
    min_height_m: float = Field(0.3, description="lowest kept height above ground")
    max_height_m: float = Field(2.5, description="highest kept height above ground")
    min_range_m: float = Field(2.5, ge=0, description="nearer points lie on the vehicle itself")
    find: GroundConfig = Field(default_factory=GroundConfig)

    def reaching(self, grid: BevGrid) -> GroundStage:
        """Return the same settings, with a reach that covers the whole grid."""
        if grid.reach_m <= self.find.reach_m:
            return self
        find = self.find.model_copy(update={"reach_m": grid.reach_m})
        return self.model_copy(update={"find": find})


def elapsed_seconds(past: Sequence[Sweep], current: Sweep) -> float:
    """Return the seconds from the newest sweep of ``past`` to ``current``.

    Raises:
        InputError: there is no past, or the sweeps are not in order of time.
    """
    if not past:
        raise InputError("past", "empty", "at least one earlier sweep")
    for earlier, later in pairwise([*past, current]):
        if later.stamp_ns <= earlier.stamp_ns:
            name = "current" if later is current else "a past sweep"
            raise InputError(f"stamp_ns of {name}", later.stamp_ns, f"> {earlier.stamp_ns}")
    return seconds_between(past[-1].stamp_ns, current.stamp_ns)


def is_measurable(previous: Sweep, current: Sweep) -> bool:
    """Return whether motion between two sweeps can be searched: no jump, no gap lies between."""
    elapsed_s = seconds_between(previous.stamp_ns, current.stamp_ns)
    return elapsed_s <= LONGEST_SEARCH_S and not has_jumped(previous, current)


def unmeasured(grid: BevGrid, obstacles: Sweep) -> FlowField:
    """Return a field of the obstacle points of the current sweep of which nothing was measured."""
    return FlowField.unmeasured(grid, grid.occupancy(obstacles.xyz_m), obstacles.stamp_ns)


def obstacle_points(sweep: Sweep, stage: GroundStage) -> tuple[Sweep, F32]:
    """Return the obstacle points of a sweep (own ego frame) and their height (M,) in metres."""
    if len(sweep) == 0:
        return sweep, np.zeros(0, np.float32)
    height_m = find_ground(sweep.xyz_m, stage.find).height_m
    x_m, y_m = sweep.xyz_m[:, 0], sweep.xyz_m[:, 1]
    kept = x_m * x_m + y_m * y_m > stage.min_range_m**2
    kept &= np.maximum(np.abs(x_m), np.abs(y_m)) < stage.find.reach_m
    if stage.enabled:
        kept &= (height_m > stage.min_height_m) & (height_m < stage.max_height_m)
    index = np.flatnonzero(kept)
    return sweep.select(index), height_m.take(index)


class SweepFeatures:
    """Everything computed of one sweep alone, in its own ego frame, on first use."""

    def __init__(self, sweep: Sweep, ground: GroundStage) -> None:
        self.sweep = sweep
        self._ground = ground
        self._thinned: dict[float, I64] = {}

    @cached_property
    def obstacles(self) -> tuple[Sweep, F32]:
        """The obstacle points and their height (M,) above the ground."""
        return obstacle_points(self.sweep, self._ground)

    @cached_property
    def farthest_m(self) -> F64:
        """(720,) range of the farthest return in each half degree of azimuth."""
        return farthest_returns(self.sweep)

    @cached_property
    def image(self) -> RangeImage:
        """The range image of all returns."""
        return build_range_image(self.sweep.xyz_m, self.sweep.origin_m)

    def thinned(self, voxel_m: float) -> I64:
        """Return the indices of one obstacle point per cube of `voxel_m` metres."""
        if voxel_m not in self._thinned:
            self._thinned[voxel_m] = first_in_voxel(self.obstacles[0].xyz_m, voxel_m)
        return self._thinned[voxel_m]


class RecentFeatures:
    """Features of the last sweeps, since a sweep is the current and then a past one.

    Sweeps are distinguished by identity.
    """

    def __init__(self, ground: GroundStage) -> None:
        self._ground = ground
        self.reach_m = ground.find.reach_m
        self._recent: list[SweepFeatures] = []

    def of(self, sweep: Sweep) -> SweepFeatures:
        """Return the stored features of a sweep, or new ones."""
        for features in self._recent:
            if features.sweep is sweep:
                return features
        self._recent.append(SweepFeatures(sweep, self._ground))
        return self._recent[-1]

    def keep(self, oldest: Sweep, newest: Sweep) -> None:
        """Remove the features of sweeps before or after these: no later estimate asks for them."""
        first_ns, last_ns = oldest.stamp_ns, newest.stamp_ns
        self._recent = [f for f in self._recent if first_ns <= f.sweep.stamp_ns <= last_ns]

    def clear(self) -> None:
        """Remove the features of every sweep."""
        self._recent.clear()


@dataclass(frozen=True, slots=True)
class PastSweep:
    """An earlier sweep, prepared for an estimator: its points are in the CURRENT ego frame."""

    obstacles: Sweep
    """Obstacle points; ego motion (and its residual, if aligned) removed."""
    height_m: F32
    """(N,) height of each obstacle point above the ground."""
    features: SweepFeatures
    """In the sweep's OWN ego frame."""
    sweep_T_current: Pose
    """From the current ego frame to the sweep's own; corrected if aligned."""
    elapsed_s: float
    """Time from its stamp to the current one."""


@dataclass(frozen=True, slots=True)
class SweepPair:
    """The current sweep and its past, prepared; everything is in the CURRENT ego frame.

    The newest sweep of the past is the other one of the pair, here called the previous one. The
    older ones give longer baselines; at the start of a drive there is none.
    """

    past: tuple[PastSweep, ...]
    """At least one, from the oldest to the newest."""
    current: Sweep
    """Obstacle points of the current sweep."""
    current_features: SweepFeatures
    """Of the current sweep."""
    current_height_m: F32
    """(N_current,) height of each obstacle point above the ground."""
    reach_m: float
    """Half side of the square about the vehicle in which obstacle points are kept."""
    current_seen: I8 | None
    """(H, W) UNSEEN, FREE or OCCUPIED in the current sweep; None if the stage is off."""
    previous_seen: I8 | None
    """(H, W) the same in the previous sweep."""

    @property
    def previous(self) -> Sweep:
        """Obstacle points of the previous sweep; ego motion (and its residual) removed."""
        return self.past[-1].obstacles

    @property
    def previous_features(self) -> SweepFeatures:
        """Of the previous sweep, in ITS ego frame."""
        return self.past[-1].features

    @property
    def previous_T_current(self) -> Pose:
        """From the current ego frame to the previous sweep's own; corrected if aligned."""
        return self.past[-1].sweep_T_current

    @property
    def previous_height_m(self) -> F32:
        """(N_previous,) height of each obstacle point above the ground."""
        return self.past[-1].height_m

    @property
    def elapsed_s(self) -> float:
        """Time between the stamps of the previous and the current sweep."""
        return self.past[-1].elapsed_s


def flow_field(
    grid: BevGrid, obstacles: Sweep, velocity_mps: F64, valid: Mask, variance_m2ps2: F64 | float
) -> FlowField:
    """Return a field whose errors have the same variance along every direction.

    Args:
        grid: the grid of the field.
        obstacles: obstacle points of the current sweep, which occupy the cells.
        velocity_mps: (H, W, 2) velocity of each cell.
        valid: (H, W) cells that were measured, if occupied.
        variance_m2ps2: (H, W) variance of either component, or one for all cells.
    """
    occupied = grid.occupancy(obstacles.xyz_m)
    valid = valid & occupied
    variance = np.where(valid, variance_m2ps2, 0.0).astype(np.float32)
    return FlowField(
        grid=grid,
        velocity_mps=np.where(valid[..., None], velocity_mps, 0.0).astype(np.float32),
        covariance_m2ps2=variance[..., None, None] * np.eye(2, dtype=np.float32),
        occupied=occupied,
        valid=valid,
        weight=occupied.astype(np.float32),
        stamp_ns=obstacles.stamp_ns,
    )
