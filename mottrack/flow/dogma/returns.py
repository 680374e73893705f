"""A sweep as returns on the plane, classified as ground, obstacle or overhead."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F32, F64, U8
from mottrack.core.sweep import Sweep
from mottrack.flow.sweep_pair import GroundStage
from mottrack.lidar.ground import find_ground

GROUND, OBSTACLE, OVERHEAD, OWN = (np.uint8(kind) for kind in range(4))
"""What reflected a point. Overhead points only show that their direction is in view; points of the
own vehicle are no evidence at all."""


class Returns(NamedTuple):
    """N points of a sweep on the plane, around the sensor's optical centre."""

    xy_m: F32
    """(N, 2) along the world's axes, from the optical centre."""
    kind: U8
    """(N,) GROUND, OBSTACLE, OVERHEAD or OWN."""
    centre_m: F64
    """(2,) the optical centre in the world."""


def returns_of(sweep: Sweep, stage: GroundStage) -> Returns:
    """Classify the points: between the stage's two heights obstacles, ground below."""
    pose = sweep.world_T_ego
    x_m, y_m, z_m = (sweep.xyz_m - sweep.origin_m.astype(np.float32)).T
    xy_m = np.empty((len(sweep), 2), np.float32)
    for axis in range(2):
        # by column: a product with so thin a matrix would start the threads of BLAS
        to_x, to_y, to_z = pose.rotation[axis].astype(np.float32)
        xy_m[:, axis] = x_m * to_x + y_m * to_y + z_m * to_z
    return Returns(xy_m, _kinds(sweep.xyz_m, stage), pose.apply(sweep.origin_m[None])[0, :2])


def _kinds(xyz_m: F32, stage: GroundStage) -> U8:
    """Return (N,) what reflected each point (N, 3) of the ego frame."""
    kind = np.full(len(xyz_m), OBSTACLE)
    if len(xyz_m) and stage.enabled:
        height_m = find_ground(xyz_m, stage.find).height_m
        kind[height_m >= stage.max_height_m] = OVERHEAD
        kind[height_m <= stage.min_height_m] = GROUND
    kind[xyz_m[:, 0] ** 2 + xyz_m[:, 1] ** 2 <= stage.min_range_m**2] = OWN
    return kind
