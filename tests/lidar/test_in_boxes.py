"""Points in rotated boxes, against the definition."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.core.errors import InputError
from mottrack.core.objects import Boxes
from mottrack.core.pictures import footprints
from mottrack.lidar.in_boxes import near_boxes, points_in_boxes


def by_definition(xyz, centre, size, yaw, margin):
    inside = []
    for c, s, a in zip(centre, size, yaw, strict=True):
        local = (xyz - c) @ np.array(
            [[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]
        )
        inside.append(np.flatnonzero((np.abs(local) <= s / 2 + margin).all(axis=1)))
    return inside


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), margin=st.sampled_from([0.0, 0.15]))
def test_agrees_with_the_definition(seed, margin):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform([-60, -60, -2], [60, 60, 4], (2000, 3)).astype(np.float32)
    boxes = rng.integers(0, 30)
    centre = rng.uniform([-70, -70, -1], [70, 70, 2], (boxes, 3))
    size = rng.uniform(0.3, 25, (boxes, 3))
    yaw = rng.uniform(-7, 7, boxes)
    found = points_in_boxes(xyz, centre, size, yaw, margin)
    for b, expected in enumerate(by_definition(xyz.astype(float), centre, size, yaw, margin)):
        np.testing.assert_array_equal(found.of(b), expected)


def test_a_point_in_two_boxes_belongs_to_the_first():
    xyz = np.zeros((1, 3), np.float32)
    found = points_in_boxes(xyz, np.zeros((2, 3)), np.ones((2, 3)), np.zeros(2))
    assert found.first_box(1).tolist() == [0]
    assert len(found.index) == 2


def test_no_points_and_no_boxes():
    none = points_in_boxes(np.zeros((0, 3)), np.zeros((2, 3)), np.ones((2, 3)), np.zeros(2))
    assert none.start.tolist() == [0, 0, 0]
    free = points_in_boxes(np.zeros((5, 3)), np.zeros((0, 3)), np.ones((0, 3)), np.zeros(0))
    assert free.first_box(5).tolist() == [-1] * 5


def test_shapes_must_agree():
    with pytest.raises(InputError, match=r"shape of size_m is \(1, 3\), expected \(2, 3\)"):
        points_in_boxes(np.zeros((5, 3)), np.zeros((2, 3)), np.ones((1, 3)), np.zeros(2))


def test_near_boxes_agrees_with_the_distance_of_shapely():
    rng = np.random.default_rng(3)
    boxes = Boxes(
        stamp_ns=0,
        centre_m=rng.uniform(-10, 10, (6, 3)),
        size_m=rng.uniform(0.5, 6, (6, 3)),
        yaw_rad=rng.uniform(-4, 4, 6),
        label=np.full(6, "car"),
    )
    xy_m = rng.uniform(-15, 15, (400, 2))
    outlines = shapely.polygons(footprints(boxes.centre_m, boxes.size_m, boxes.yaw_rad))
    apart_m = shapely.distance(shapely.points(xy_m)[:, None], outlines[None]).min(axis=1)
    np.testing.assert_array_equal(near_boxes(xy_m, boxes, 1.5), apart_m < 1.5)
    assert not near_boxes(xy_m, boxes.select(np.zeros(6, np.bool_)), 1.5).any()
