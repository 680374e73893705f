"""Returns from the body of the ego vehicle, as a LiDAR on its roof has them in every sweep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mottrack.core import Sweep
from mottrack.core.arrays import F64

BODY_M = np.array(
    [
        [[-0.62, -0.86, 0.2], [1.4, 0.86, 1.5]],
        [[1.4, -0.86, 0.2], [3.4, 0.86, 1.0]],
        [[1.2, -0.96, 0.9], [1.4, 0.96, 1.1]],
    ]
)
"""(3, 2, 3) least and largest x, y, z in the ego frame of cabin, bonnet and mirrors: a compact car
of 4.1 by 1.7 m as nuScenes', its rear axle at the origin."""
REFLECTANCE = 0.1
"""Dark paint, which shines the beams away."""


def with_own_body(sweep: Sweep, velocity_mps: F64) -> Sweep:
    """Return the sweep with the body in the way of its beams, smeared by motion compensation.

    A beam that meets the body ends there. Compensation takes the body, which travels with the
    vehicle, for a thing that stands: a return of t seconds before the stamp lands t times the
    velocity behind its place.

    Args:
        sweep: of a sensor above the body.
        velocity_mps: (3,) of the vehicle, ego axes.
    """
    share = np.min([_entry(sweep, box) for box in BODY_M], axis=0)
    hit = share < 1.0
    xyz_m = sweep.xyz_m.astype(np.float64)
    xyz_m[hit] = sweep.origin_m + share[hit, None] * (xyz_m[hit] - sweep.origin_m)
    if sweep.time_offset_ns is not None:
        xyz_m[hit] += 1e-9 * sweep.time_offset_ns[hit, None] * velocity_mps
    reflectance = np.where(hit, np.float32(REFLECTANCE), sweep.reflectance)
    return replace(sweep, xyz_m=xyz_m.astype(np.float32), reflectance=reflectance)


def _entry(sweep: Sweep, box_m: F64) -> F64:
    """Return (N,) the share of each beam's way at which it enters a box; inf where it misses.

    The slab method: a line is inside the box where it is inside all three pairs of faces.
    """
    way = sweep.xyz_m - sweep.origin_m
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed = (box_m[:, None, :] - sweep.origin_m) / way
    enters = np.nanmax(crossed.min(axis=0), axis=1)
    leaves = np.nanmin(crossed.max(axis=0), axis=1)
    return np.where((enters < leaves) & (enters > 0.0), enters, np.inf)
