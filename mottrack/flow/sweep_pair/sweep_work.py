"""What is made of one sweep alone, so that it need not be made again when it is the earlier one."""

from __future__ import annotations

from collections import deque
from functools import cached_property

from mottrack.core.arrays import F32, F64, I64
from mottrack.core.sweep import Sweep
from mottrack.flow.sweep_pair.obstacle_points import GroundStage, keep_points
from mottrack.lidar.range_image import RangeImage, build_range_image
from mottrack.lidar.thinning import first_in_voxel
from mottrack.lidar.visibility import farthest_returns

_REMEMBERED = 3
"""At 20 Hz the earlier sweep of a pair is the one before the last."""


class SweepFeatures:
    """Everything that depends on one sweep, in its own ego frame; each part made when asked for."""

    def __init__(self, sweep: Sweep, ground: GroundStage) -> None:
        self.sweep = sweep
        self._ground = ground
        self._thinned: dict[float, I64] = {}

    @cached_property
    def kept(self) -> tuple[Sweep, F32]:
        """The points that stand for objects, and their height above the ground."""
        return keep_points(self.sweep, self._ground)

    @cached_property
    def farthest_m(self) -> F64:
        """(720,) how far the sweep saw in each half degree."""
        return farthest_returns(self.sweep)

    @cached_property
    def image(self) -> RangeImage:
        """The range image of all returns."""
        return build_range_image(self.sweep.xyz_m, self.sweep.origin_m)

    def thinned(self, voxel_m: float) -> I64:
        """Indices of the kept points of which there is one per cube."""
        if voxel_m not in self._thinned:
            self._thinned[voxel_m] = first_in_voxel(self.kept[0].xyz_m, voxel_m)
        return self._thinned[voxel_m]


class RecentWork:
    """The work on the last few sweeps: the same object is the same sweep."""

    def __init__(self, ground: GroundStage) -> None:
        self._ground = ground
        self._recent: deque[SweepFeatures] = deque(maxlen=_REMEMBERED)

    def of(self, sweep: Sweep) -> SweepFeatures:
        """The work on a sweep, remembered or begun."""
        for work in self._recent:
            if work.sweep is sweep:
                return work
        work = SweepFeatures(sweep, self._ground)
        self._recent.append(work)
        return work

    def forget(self) -> None:
        """Forgets every sweep."""
        self._recent.clear()
