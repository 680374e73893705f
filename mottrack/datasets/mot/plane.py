"""Boxes in an image as boxes on a plane: 1 px is 5 cm, x to the right, y up.

All boxes are equally high and stand at one height, so that their 3-D IoU is the IoU of their
rectangles, by which MOTChallenge matches: `scores.match_by: iou`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64

METRES_PER_PX = 0.05
"""An image of 1920 px is 96 m wide, of which the player shows most at once; its steps are 1 cm."""
LEAST_PX = 1e-3
"""Sizes must be positive; files have boxes without an area, which match nothing either way."""


class PlaneBoxes(NamedTuple):
    """Boxes on the plane: centre_m, size_m (N, 3)."""

    centre_m: F64
    size_m: F64


def to_plane(left_top_size_px: F64) -> PlaneBoxes:
    """Return (N, 4) boxes left, top, width, height on the plane."""
    left, top, width, height = left_top_size_px.T
    centre = np.column_stack([left + width / 2, -(top + height / 2), np.zeros_like(left)])
    size = np.column_stack([np.maximum(width, LEAST_PX), np.maximum(height, LEAST_PX)])
    flat = np.full((len(size), 1), 1.0)
    return PlaneBoxes(METRES_PER_PX * centre, np.hstack([METRES_PER_PX * size, flat]))


def to_image(boxes: PlaneBoxes) -> F64:
    """Return (N, 4) left, top, width, height in pixels; the inverse of `to_plane`."""
    centre, size = boxes.centre_m[:, :2] / METRES_PER_PX, boxes.size_m[:, :2] / METRES_PER_PX
    left, top = centre[:, 0] - size[:, 0] / 2, -centre[:, 1] - size[:, 1] / 2
    return np.column_stack([left, top, size])
