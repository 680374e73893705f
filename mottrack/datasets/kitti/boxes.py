"""KITTI boxes: in the rectified camera frame, in the ego frame and in the image.

KITTI's camera looks along z, x is right and y is down; a box is given by the centre of its bottom
face, (h, w, l) and the rotation `ry` about y. mottrack's ego frame is the Velodyne's (x forward,
y left, z up); a box there is its centre, (l, w, h) and a yaw about z. The headings are related by
yaw = -ry - pi/2: both count from the forward-pointing axes, and z points against y.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core import Pose
from mottrack.core.arrays import F64, Mask

# image size and rectified projection of the training sequences (P2 of the calibration files)
WIDTH_PX, HEIGHT_PX = 1219.0, 375.0
PROJECTION = np.array(
    [[721.5377, 0.0, 609.5593, 0.0], [0.0, 721.5377, 172.854, 0.0], [0.0, 0.0, 1.0, 0.0]]
)
"""P2 of KITTI's calibration of 2011-09-26; the image is twice its principal point wide."""
FIELD_OF_VIEW_RAD = float(np.arctan2(PROJECTION[0, 2], PROJECTION[0, 0]))


class ImageSize(NamedTuple):
    """Of a picture, in pixels."""

    width_px: float
    height_px: float


NOMINAL = ImageSize(WIDTH_PX, HEIGHT_PX)
LARGEST = ImageSize(1242.0, 376.0)
"""Of KITTI's images the largest; each day's are cut to slightly other sizes."""
_NEAREST_M = 0.1
"""Corners nearer than this, or behind the camera, are projected as if they were this far away."""


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
        yaw_rad=_converted_heading(boxes.ry_rad),
    )


def ego_to_camera(boxes: EgoBoxes, ego_T_camera: Pose) -> CameraBoxes:
    """Return the boxes in the rectified camera frame; the inverse of `camera_to_ego`."""
    bottom = ego_T_camera.inverse().apply(boxes.centre_m)
    bottom[:, 1] += boxes.size_m[:, 2] / 2.0
    return CameraBoxes(
        bottom_m=bottom,
        size_hwl_m=boxes.size_m[:, ::-1].copy(),
        ry_rad=_converted_heading(boxes.yaw_rad),
    )


def _converted_heading(angle_rad: F64) -> F64:
    """Return -angle - pi/2 in [-pi, pi), which is its own inverse."""
    return np.mod(-angle_rad + np.pi / 2.0, 2.0 * np.pi) - np.pi


def image_boxes(
    camera: CameraBoxes, projection: F64 = PROJECTION, size: ImageSize = NOMINAL
) -> F64:
    """Return (N, 4) x1, y1, x2, y2 in pixels, clipped to the image, that hold the eight corners.

    The image is that of the left colour camera, to which the (3, 4) `projection` leads.
    """
    x, y = _pixels(camera, projection)
    x, y = np.clip(x, 0.0, size.width_px), np.clip(y, 0.0, size.height_px)
    return np.column_stack([x.min(axis=1), y.min(axis=1), x.max(axis=1), y.max(axis=1)])


def in_image(camera: CameraBoxes, projection: F64 = PROJECTION) -> Mask:
    """Return which boxes (N,) the left colour camera sees any of."""
    x, y = _pixels(camera, projection)
    ahead = camera.bottom_m[:, 2] > _NEAREST_M
    across = (x.max(axis=1) > 0.0) & (x.min(axis=1) < LARGEST.width_px)
    return np.asarray(ahead & across & (y.max(axis=1) > 0.0) & (y.min(axis=1) < LARGEST.height_px))


class _Pixels(NamedTuple):
    """Places of the corners in the image, (N, 8) each."""

    x: F64
    y: F64


def _pixels(camera: CameraBoxes, projection: F64) -> _Pixels:
    corners, p = _corners(camera), projection
    depth = np.maximum(corners[..., 2] + p[2, 3], _NEAREST_M)
    return _Pixels(
        (p[0, 0] * corners[..., 0] + p[0, 3]) / depth + p[0, 2],
        (p[1, 1] * corners[..., 1] + p[1, 3]) / depth + p[1, 2],
    )


def _corners(camera: CameraBoxes) -> F64:
    """Return (N, 8, 3) corners in the camera frame."""
    height, width, length = camera.size_hwl_m.T
    signs = np.array([[a, b, c] for a in (-0.5, 0.5) for b in (-1.0, 0.0) for c in (-0.5, 0.5)])
    along, up, across = (signs[:, i] * s[:, None] for i, s in enumerate((length, height, width)))
    cos, sin = np.cos(camera.ry_rad)[:, None], np.sin(camera.ry_rad)[:, None]
    offset = np.stack([cos * along + sin * across, up, -sin * along + cos * across], axis=-1)
    corners: F64 = camera.bottom_m[:, None] + offset
    return corners
