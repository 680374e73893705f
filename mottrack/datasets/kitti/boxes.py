"""KITTI boxes: the rectified camera's frame and the ego frame, exactly, both ways.

KITTI's camera looks along z, x is right and y is down; a box is given by the centre of its bottom
face, (h, w, l) and the rotation `ry` about y. mottrack's ego frame is the Velodyne's (x forward,
y left, z up); a box there is its centre, (l, w, h) and a yaw about z. The headings are related by
yaw = -ry - pi/2: both count from the forward-pointing axes, and z points against y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core import Pose
from mottrack.core.arrays import F64


@dataclass(frozen=True)
class CameraBoxes:
    """N boxes as KITTI writes them, in the rectified camera frame.

    bottom_m: (N, 3) centre of the bottom face, metres.
    size_hwl_m: (N, 3) height, width, length, metres.
    ry_rad: (N,) rotation about the camera's y axis, in [-pi, pi).
    """

    bottom_m: F64
    size_hwl_m: F64
    ry_rad: F64


@dataclass(frozen=True)
class EgoBoxes:
    """N boxes in the ego frame: centre_m (N, 3), size_m (N, 3) as l, w, h, yaw_rad (N,)."""

    centre_m: F64
    size_m: F64
    yaw_rad: F64


def camera_to_ego(boxes: CameraBoxes, ego_T_camera: Pose) -> EgoBoxes:
    """Return the boxes in the ego frame."""
    centre_camera = boxes.bottom_m.copy()
    centre_camera[:, 1] -= boxes.size_hwl_m[:, 0] / 2.0
    return EgoBoxes(
        centre_m=ego_T_camera.apply(centre_camera),
        size_m=boxes.size_hwl_m[:, ::-1].copy(),
        yaw_rad=_turned(boxes.ry_rad),
    )


def ego_to_camera(boxes: EgoBoxes, ego_T_camera: Pose) -> CameraBoxes:
    """Return the boxes in the rectified camera frame; the inverse of `camera_to_ego`."""
    bottom = ego_T_camera.inverse().apply(boxes.centre_m)
    bottom[:, 1] += boxes.size_m[:, 2] / 2.0
    return CameraBoxes(
        bottom_m=bottom,
        size_hwl_m=boxes.size_m[:, ::-1].copy(),
        ry_rad=_turned(boxes.yaw_rad),
    )


def _turned(angle_rad: F64) -> F64:
    """-angle - pi/2 in [-pi, pi): its own inverse."""
    turned: F64 = np.mod(-angle_rad + np.pi / 2.0, 2.0 * np.pi) - np.pi
    return turned
