"""Neighbour search and thinning, against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mottrack.core.errors import InputError
from mottrack.lidar.point_grid import build_point_grid, first_in_voxel, nearest
from mottrack.lidar.residual import translation_icp, truncated_residual


def cloud(seed, count=3000, reach=15):
    rng = np.random.default_rng(seed)
    return rng.uniform([-reach, -reach, 0], [reach, reach, 2], (count, 3)).astype(np.float32)


@pytest.mark.parametrize("gate_m", [0.2, 0.5, 1.3])
def test_nearest_is_that_of_a_tree(gate_m):
    points, queries = cloud(0), cloud(1, 300, 18)
    grid = build_point_grid(points, 0.5, 20.0)
    distance, index = cKDTree(points).query(queries, distance_upper_bound=gate_m)
    for q, d, i in zip(queries, distance, index, strict=True):
        k, d2 = nearest(grid, *q, gate_m)
        if np.isfinite(d):
            assert grid.order[k] == i
            assert d2 == pytest.approx(d * d, rel=1e-3)
        else:
            assert k == -1
            assert d2 == pytest.approx(gate_m**2)


def test_points_outside_are_left_out():
    grid = build_point_grid(np.array([[0, 0, 0], [30, 0, 0]], np.float32), 0.5, 10.0)
    assert grid.order.tolist() == [0]


def test_a_wrong_shape_is_named():
    flat = np.zeros((3, 2), np.float32)
    for use in (lambda: build_point_grid(flat, 0.5), lambda: first_in_voxel(flat, 0.5)):
        with pytest.raises(InputError, match=r"shape of xyz_m is \(3, 2\), expected \(N, 3\)"):
            use()


def test_residual_of_the_true_shift_is_zero_and_icp_finds_it():
    points = cloud(2, 400, 3)
    grid = build_point_grid(points + np.array([0.12, -0.07, 0], np.float32), 0.5, 20.0)
    gates = np.geomspace(0.5, 0.1, 12)
    shift = translation_icp(grid, points, (0.0, 0.0), gates)
    assert shift == pytest.approx((0.12, -0.07), abs=1e-3)
    assert truncated_residual(grid, points, shift, 0.5) < 2e-3
    assert truncated_residual(grid, points, (9.0, 9.0), 0.5) == pytest.approx(0.5)


def test_one_point_a_voxel():
    points = cloud(3)
    kept = first_in_voxel(points, 0.5)
    voxels = np.floor(points.astype(float) / 0.5).astype(int)
    _, first = np.unique(voxels, axis=0, return_index=True)
    np.testing.assert_array_equal(kept, np.sort(first))
