"""Rotated-box overlap against shapely, and the laws any overlap obeys."""

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from mottrack.core.errors import InputError
from mottrack.geometry import iou
from mottrack.geometry.polygon import clip_area, polygon_area


def random_boxes(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    boxes = np.empty((count, 7))
    boxes[:, :2] = rng.uniform(-6, 6, (count, 2)) + np.array([1200.0, -3400.0])
    boxes[:, 2] = rng.uniform(-1, 1, count)
    boxes[:, 3:6] = rng.uniform(0.3, 5, (count, 3))
    boxes[:, 6] = rng.uniform(-4, 4, count)
    return boxes


def test_all_four_measures_agree_with_shapely() -> None:
    rng = np.random.default_rng(0)
    a, b = random_boxes(rng, 40), random_boxes(rng, 50)
    shape_a = shapely.polygons(iou.bev_corners(a))[:, None]
    shape_b = shapely.polygons(iou.bev_corners(b))[None, :]
    shared = shapely.area(shapely.intersection(shape_a, shape_b))
    union = shapely.area(shape_a) + shapely.area(shape_b) - shared
    hull = shapely.area(shapely.convex_hull(shapely.union(shape_a, shape_b)))
    top = np.minimum.outer(a[:, 2] + a[:, 5] / 2, b[:, 2] + b[:, 5] / 2)
    bottom = np.maximum.outer(a[:, 2] - a[:, 5] / 2, b[:, 2] - b[:, 5] / 2)
    height = np.clip(top - bottom, 0, None)
    span = np.maximum.outer(a[:, 2] + a[:, 5] / 2, b[:, 2] + b[:, 5] / 2) - np.minimum.outer(
        a[:, 2] - a[:, 5] / 2, b[:, 2] - b[:, 5] / 2
    )
    volumes = np.add.outer(np.prod(a[:, 3:6], 1), np.prod(b[:, 3:6], 1)) - shared * height
    body = hull * span
    assert np.count_nonzero(shared) > 300
    np.testing.assert_allclose(iou.bev_iou(a, b), shared / union, atol=1e-9)
    np.testing.assert_allclose(iou.iou_3d(a, b), shared * height / volumes, atol=1e-9)
    expected = shared / union - (hull - union) / hull
    np.testing.assert_allclose(iou.giou_bev(a, b), expected, atol=1e-9)
    expected = shared * height / volumes - (body - volumes) / body
    np.testing.assert_allclose(iou.giou_3d(a, b), expected, atol=1e-9)


def test_a_box_overlaps_itself_wholly_and_far_boxes_not_at_all() -> None:
    boxes = random_boxes(np.random.default_rng(1), 200)
    for measure in (iou.bev_iou, iou.iou_3d, iou.giou_bev, iou.giou_3d):
        np.testing.assert_allclose(np.diag(measure(boxes, boxes)), 1.0, atol=1e-12)
    away = boxes + np.array([100.0, 0, 0, 0, 0, 0, 0])
    assert not iou.bev_iou(boxes, away).any()
    assert (iou.giou_3d(boxes, away) < -0.5).all()


def test_half_turn_changes_nothing_and_order_is_symmetric() -> None:
    rng = np.random.default_rng(2)
    a, b = random_boxes(rng, 30), random_boxes(rng, 30)
    turned = a + np.array([0, 0, 0, 0, 0, 0, np.pi])
    np.testing.assert_allclose(iou.iou_3d(turned, b), iou.iou_3d(a, b), atol=1e-12)
    np.testing.assert_allclose(iou.giou_3d(a, b), iou.giou_3d(b, a).T, atol=1e-12)


def test_empty_sets_flat_boxes_and_malformed_input() -> None:
    one = np.array([[0.0, 0, 0, 2, 1, 1, 0]])
    assert iou.iou_3d(np.empty((0, 7)), one).shape == (0, 1)
    assert iou.giou_bev(one, []).shape == (1, 0)
    assert iou.bev_iou(one * [1, 1, 1, 0, 1, 1, 1], one)[0, 0] == 0.0
    with pytest.raises(InputError, match=r"shape of a is \(1, 6\)"):
        iou.bev_iou(one[:, :6], one)
    with pytest.raises(InputError, match=r"b\[0, 2\] is nan"):
        iou.bev_iou(one, one * [1, 1, np.nan, 1, 1, 1, 1])
    with pytest.raises(InputError, match=r"extent of a\[0, 1\] is -1.0, expected at least 0 m"):
        iou.iou_3d(one * [1, 1, 1, 1, -1, 1, 1], one)


def test_clipping_of_hulls_agrees_with_shapely() -> None:
    rng = np.random.default_rng(3)
    for _ in range(100):
        shapes = [shapely.MultiPoint(rng.normal(0, 2, (9, 2))).convex_hull for _ in range(2)]
        one, two = (np.array(shape.exterior.coords)[-1:0:-1] for shape in shapes)
        expected = shapes[0].intersection(shapes[1]).area
        work = np.empty((2, len(one) + len(two) + 1, 2))
        assert clip_area(one, two, work) == pytest.approx(expected, abs=1e-9)
        assert polygon_area(one) == pytest.approx(shapes[0].area)
