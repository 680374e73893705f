"""LiDAR returns in labelled boxes; apart, since only writers need the compiled kernel."""

from __future__ import annotations

import numpy as np

from mottrack.core import Sweep, Truth
from mottrack.core.arrays import I64
from mottrack.lidar.in_boxes import points_in_boxes


def counted_points(truth: Truth, sweep: Sweep | None) -> I64:
    """Return (N,) LiDAR returns in each box: as the labels say, else counted in the sweep.

    Where neither is known the count is 0.
    """
    known = truth.num_points >= 0
    if known.all() or sweep is None:
        return np.where(known, truth.num_points, 0)
    ego = truth.transformed(sweep.world_T_ego.inverse(), "ego")
    found = points_in_boxes(sweep.xyz_m, ego.centre_m, ego.size_m, ego.yaw_rad)
    return np.where(known, truth.num_points, np.diff(found.start))
