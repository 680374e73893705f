"""Which points of a sweep stand for objects."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32
from mottrack.core.grid import BevGrid
from mottrack.core.sweep import Sweep
from mottrack.lidar.ground import GroundConfig, find_ground


class GroundStage(StrictModel):
    """Which points are kept, by their height above the ground and their range.

    Ground is looked for, and points are kept, as far as `find.reach_m`, or as the grid reaches if
    that is farther.
    """

    enabled: bool = Field(True, description="remove the ground; off keeps every point in range")
    min_height_m: float = Field(0.3, description="lowest kept height above ground")
    max_height_m: float = Field(2.5, description="highest kept height above ground")
    min_range_m: float = Field(2.5, ge=0, description="nearer points lie on the vehicle itself")
    find: GroundConfig = Field(default_factory=GroundConfig)

    def reaching(self, grid: BevGrid) -> GroundStage:
        """The same settings, with a reach that leaves no cell of the grid out."""
        if grid.reach_m <= self.find.reach_m:
            return self
        find = self.find.model_copy(update={"reach_m": grid.reach_m})
        return self.model_copy(update={"find": find})


def keep_points(sweep: Sweep, stage: GroundStage) -> tuple[Sweep, F32]:
    """The points of a sweep (own ego frame) that stand for objects, and their height (M,) m."""
    if len(sweep) == 0:
        return sweep, np.zeros(0, np.float32)
    height_m = find_ground(sweep.xyz_m, stage.find).height_m
    x_m, y_m = sweep.xyz_m[:, 0], sweep.xyz_m[:, 1]
    kept = x_m * x_m + y_m * y_m > stage.min_range_m**2
    kept &= np.maximum(np.abs(x_m), np.abs(y_m)) < stage.find.reach_m
    if stage.enabled:
        kept &= (height_m > stage.min_height_m) & (height_m < stage.max_height_m)
    return sweep.select(kept), height_m[kept]
