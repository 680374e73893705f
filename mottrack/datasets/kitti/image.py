"""Boxes in the image of KITTI's left colour camera."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64
from mottrack.datasets.kitti.boxes import CameraBoxes

WIDTH_PX, HEIGHT_PX = 1219.0, 375.0
PROJECTION = np.array(
    [[721.5377, 0.0, 609.5593, 0.0], [0.0, 721.5377, 172.854, 0.0], [0.0, 0.0, 1.0, 0.0]]
)
FIELD_OF_VIEW_RAD = float(np.arctan2(PROJECTION[0, 2], PROJECTION[0, 0]))
_NEAREST_M = 0.1


def image_boxes(camera: CameraBoxes) -> F64:
    """Return (N, 4) x1, y1, x2, y2 in pixels, clipped to the image, that hold the eight corners."""
    corners = _corners(camera)
    depth = np.maximum(corners[..., 2], _NEAREST_M)
    x = PROJECTION[0, 0] * corners[..., 0] / depth + PROJECTION[0, 2]
    y = PROJECTION[1, 1] * corners[..., 1] / depth + PROJECTION[1, 2]
    x, y = np.clip(x, 0.0, WIDTH_PX), np.clip(y, 0.0, HEIGHT_PX)
    return np.column_stack([x.min(axis=1), y.min(axis=1), x.max(axis=1), y.max(axis=1)])


def _corners(camera: CameraBoxes) -> F64:
    """(N, 8, 3) corners in the camera frame."""
    height, width, length = camera.size_hwl_m.T
    signs = np.array([[a, b, c] for a in (-0.5, 0.5) for b in (-1.0, 0.0) for c in (-0.5, 0.5)])
    along, up, across = (signs[:, i] * s[:, None] for i, s in enumerate((length, height, width)))
    cos, sin = np.cos(camera.ry_rad)[:, None], np.sin(camera.ry_rad)[:, None]
    offset = np.stack([cos * along + sin * across, up, -sin * along + cos * across], axis=-1)
    corners: F64 = camera.bottom_m[:, None] + offset
    return corners
