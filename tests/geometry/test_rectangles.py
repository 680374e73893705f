"""Upright rectangles against the rotated boxes of `iou`, which shapely vouches for."""

import numpy as np

from mottrack.geometry.iou import bev_intersection, bev_iou
from mottrack.geometry.rectangles import rectangle_area, rectangle_iou, shared_area


def test_upright_rectangles_are_boxes_of_no_turn() -> None:
    rng = np.random.default_rng(0)
    corner, size = rng.uniform(0, 20, (2, 40, 2)), rng.uniform(0.5, 8, (2, 40, 2))
    a, b = np.concatenate([corner, corner + size], axis=2)
    turned = np.zeros((2, 40, 7))
    turned[:, :, :2], turned[:, :, 3:5], turned[:, :, 5] = corner + size / 2, size, 1.0
    np.testing.assert_allclose(shared_area(a, b), bev_intersection(*turned), atol=1e-9)
    np.testing.assert_allclose(rectangle_iou(a, b), bev_iou(*turned), atol=1e-9)
    np.testing.assert_allclose(rectangle_area(a), size[0].prod(axis=1))
    assert rectangle_iou(np.zeros((1, 4)), np.zeros((1, 4))).tolist() == [[0.0]]
