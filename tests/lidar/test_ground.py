"""The ground under a sweep, on surfaces whose height is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.core.errors import InputError
from mottrack.lidar.ground import GroundConfig, find_ground


def street(rng, origin_above_m, slope_x, slope_y, bend=0.0):
    """Ground returns, boxes and a wall; the true height above ground of every point."""
    xy = rng.uniform(-45, 45, (8000, 2))
    ground_z = slope_x * xy[:, 0] + slope_y * xy[:, 1] + bend * xy[:, 0] ** 2 - origin_above_m
    ground = np.column_stack([xy, ground_z + rng.normal(0, 0.02, len(xy))])
    xy = np.concatenate(
        [rng.uniform(-1, 1, (300, 2)) + rng.uniform(-30, 30, 2) for _ in range(10)]
        + [np.column_stack([rng.uniform(-40, 40, 2000), np.full(2000, 15.0)])]
    )
    height = rng.uniform(0.4, 1.8, len(xy))
    z = slope_x * xy[:, 0] + slope_y * xy[:, 1] + bend * xy[:, 0] ** 2 - origin_above_m + height
    points = np.concatenate([ground, np.column_stack([xy, z])]).astype(np.float32)
    return points, np.concatenate([np.zeros(len(ground)), height])


@settings(max_examples=15, deadline=None)
@given(
    origin_above_m=st.floats(0, 2.2),
    slope_x=st.floats(-0.06, 0.06),
    slope_y=st.floats(-0.06, 0.06),
    seed=st.integers(0, 99),
)
def test_height_is_found_on_any_slope_and_from_any_origin(origin_above_m, slope_x, slope_y, seed):
    points, height = street(np.random.default_rng(seed), origin_above_m, slope_x, slope_y)
    ground = find_ground(points)
    error = np.abs(ground.height_m - height)
    assert np.quantile(error, 0.98) < 0.15
    assert ground.is_ground[height == 0].mean() > 0.99
    assert ground.is_ground[height > 0].mean() < 0.02


def test_a_bent_road_is_followed_where_a_plane_cannot():
    points, height = street(np.random.default_rng(1), 1.8, 0.0, 0.0, bend=8e-4)
    ground = find_ground(points)
    plane_m = points[:, 2] - (points[:, :2] @ ground.plane[:2] + ground.plane[2])
    far = np.abs(points[:, 0]) > 35
    assert np.abs(plane_m[far] - height[far]).max() > 0.5
    assert np.quantile(np.abs(ground.height_m[far] - height[far]), 0.95) < 0.2


def test_points_below_the_road_do_not_pull_it_down():
    rng = np.random.default_rng(3)
    points, height = street(rng, 1.5, 0.0, 0.0)
    mirrored = points[rng.integers(0, 8000, 60)] - np.array([0, 0, 1.0], np.float32)
    ground = find_ground(np.concatenate([points, mirrored]))
    assert np.quantile(np.abs(ground.height_m[: len(points)] - height), 0.98) < 0.15


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_a_handful_of_points_is_no_error(count):
    points = np.arange(3 * count, dtype=np.float32).reshape(count, 3)
    assert len(find_ground(points, GroundConfig()).height_m) == count


def test_points_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"shape of xyz_m is \(4, 2\)"):
        find_ground(np.zeros((4, 2), np.float32))
