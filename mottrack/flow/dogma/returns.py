"""A sweep as returns on the plane: what is ground, obstacle, or overhead."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.sweep import Sweep
from mottrack.flow.kept_points import GroundStage
from mottrack.lidar.ground import find_ground

GROUND, OBSTACLE, OVERHEAD = np.uint8(0), np.uint8(1), np.uint8(2)
"""What a point was reflected by. Overhead points only show that the sensor looks that way."""


class Returns(NamedTuple):
    """N points of a sweep on the plane, around the sensor's optical centre."""

    xy_m: NDArray[np.float32]
    """(N, 2) along the world's axes, from the optical centre."""
    kind: NDArray[np.uint8]
    """(N,) GROUND, OBSTACLE or OVERHEAD."""
    centre_m: NDArray[np.float64]
    """(2,) the optical centre in the world."""


def returns_of(sweep: Sweep, stage: GroundStage) -> tuple[Returns, NDArray[np.bool_]]:
    """The returns of a sweep, and which of its points they are (boolean mask).

    Points between the stage's two heights are obstacles, lower ones ground, higher ones overhead.
    """
    x_m, y_m = sweep.xyz_m[:, 0], sweep.xyz_m[:, 1]
    used = x_m * x_m + y_m * y_m > stage.min_range_m**2
    offset_m = sweep.xyz_m[used] - sweep.origin_m.astype(np.float32)
    pose = sweep.world_T_ego
    xy_m = offset_m @ pose.rotation[:2].T.astype(np.float32)
    centre_m = pose.apply(sweep.origin_m[None])[0, :2]
    return Returns(np.ascontiguousarray(xy_m), _kinds(sweep.xyz_m[used], stage), centre_m), used


def _kinds(xyz_m: NDArray[np.float32], stage: GroundStage) -> NDArray[np.uint8]:
    """GROUND, OBSTACLE or OVERHEAD for points (N, 3) in the ego frame."""
    if len(xyz_m) == 0 or not stage.enabled:
        return np.full(len(xyz_m), OBSTACLE)
    height_m = find_ground(xyz_m, stage.find).height_m
    above = np.where(height_m < stage.max_height_m, OBSTACLE, OVERHEAD)
    return np.where(height_m > stage.min_height_m, above, GROUND)
