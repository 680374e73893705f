"""Which share of an object the LiDAR sees, in the levels of nuScenes."""

from __future__ import annotations

import numpy as np

from mottrack.core import Sweep, Truth
from mottrack.core.arrays import F64
from mottrack.core.pose import wrap_angle
from mottrack.datasets.nuscenes.static_rows import VISIBILITIES, VISIBILITY_SHARES
from mottrack.geometry.iou import bev_corners, boxes7
from mottrack.lidar.in_boxes import points_in_boxes

BIN_RAD = np.deg2rad(1.0)
"""Two to three columns of a LiDAR of 1085: a lost return does not open a gap."""


def visibilities(truth: Truth, sweep: Sweep | None) -> list[str]:
    """Return the token of each object's level: the share of its width in which a return lies.

    nuScenes' annotators judged it from all cameras; without a sweep every object is visible.
    """
    tokens = list(VISIBILITIES)
    if sweep is None:
        return [tokens[-1]] * len(truth)
    ego = truth.transformed(sweep.world_T_ego.inverse(), "ego")
    found = points_in_boxes(sweep.xyz_m, ego.centre_m, ego.size_m, ego.yaw_rad)
    azimuth_rad = np.arctan2(*(sweep.xyz_m[:, :2] - sweep.origin_m[:2]).T[::-1])
    corners = bev_corners(boxes7(ego.centre_m, ego.size_m, ego.yaw_rad)) - sweep.origin_m[:2]
    shares = [_share(azimuth_rad[found.of(box)], corners[box]) for box in range(len(truth))]
    return [tokens[int(np.searchsorted(VISIBILITY_SHARES, share, "right"))] for share in shares]


def _share(azimuth_rad: F64, corners: F64) -> float:
    """Return the share of the bins between a box's corners (4, 2) that hold one of its points."""
    middle_rad = np.arctan2(*corners.mean(axis=0)[::-1])
    edges = wrap_angle(np.arctan2(corners[:, 1], corners[:, 0]) - middle_rad)
    bins = max(1, int(np.ceil((edges.max() - edges.min()) / BIN_RAD)))
    seen = np.unique((wrap_angle(azimuth_rad - middle_rad) - edges.min()) // BIN_RAD)
    return min(1.0, len(seen) / bins)
