"""Free space and occlusion around one wall."""

from __future__ import annotations

import numpy as np

from mottrack.core.grid import BevGrid
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.lidar.visibility import (
    FREE,
    OCCUPIED,
    UNSEEN,
    build_range_image,
    farthest_returns,
    fast_atan2,
    queried_from,
    states_of,
    visibility_raster,
    with_returns,
)

ORIGIN_M = np.array([0.0, 0.0, 1.8])


def wall_ahead():
    """Returns of a wall of 4 m at x = 10 and of the road before it, on a regular fan of rays."""
    azimuth, elevation = np.meshgrid(
        np.radians(np.arange(-180, 180, 0.2)), np.radians(np.arange(-20, 5, 0.4)), indexing="ij"
    )
    ray = np.stack(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ],
        axis=-1,
    ).reshape(-1, 3)
    to_wall = np.where(ray[:, 0] > 0, 10 / np.maximum(ray[:, 0], 1e-9), np.inf)
    on_wall = np.abs(to_wall * ray[:, 1]) < 2
    to_road = np.where(ray[:, 2] < 0, -ORIGIN_M[2] / np.minimum(ray[:, 2], -1e-9), np.inf)
    range_m = np.minimum(np.where(on_wall, to_wall, np.inf), to_road)
    hit = range_m < 60
    return (ORIGIN_M + ray[hit] * range_m[hit, None]).astype(np.float32)


def sweep():
    xyz = wall_ahead()
    return Sweep(xyz, np.zeros(len(xyz)), 0, Pose.identity(), ORIGIN_M)


def test_behind_a_wall_is_unseen_and_before_it_free():
    grid = BevGrid(cell_m=0.5)
    wall = sweep().xyz_m[sweep().xyz_m[:, 2] > 0.3]
    seen = visibility_raster(sweep(), farthest_returns(sweep()), grid)
    seen = with_returns(seen, wall, grid)
    rows, cols, _ = grid.cells(np.array([[5.0, 0.0], [15.0, 0.0], [10.0, 0.1], [-20.0, 3.0]]))
    assert seen[rows, cols].tolist() == [FREE, UNSEEN, OCCUPIED, FREE]


def test_a_point_is_free_occupied_or_unseen():
    image = build_range_image(wall_ahead(), ORIGIN_M)
    points = np.array([[5, 0, 1.0], [10.1, 0, 1.0], [14, 0, 1.0], [5, 0, 3.5]], np.float32)
    # above the rays that came back nothing is known
    assert states_of(image, points, 0.5).tolist() == [FREE, OCCUPIED, UNSEEN, UNSEEN]


def test_a_query_in_another_frame_equals_moved_returns():
    """Features of a sweep are computed once, in its own frame, and queried from the next one."""
    grid = BevGrid(cell_m=0.5)
    sweep_T_frame = Pose.from_yaw(0.2, (1.5, -0.4, 0.1))
    frame_T_sweep = sweep_T_frame.inverse()
    moved = Sweep(
        frame_T_sweep.apply(sweep().xyz_m).astype(np.float32),
        sweep().reflectance,
        0,
        Pose.identity(),
        frame_T_sweep.apply(ORIGIN_M[None])[0],
    )
    queried = visibility_raster(sweep(), farthest_returns(sweep()), grid, sweep_T_frame)
    assert (queried == visibility_raster(moved, farthest_returns(moved), grid)).mean() > 0.99
    places = np.random.default_rng(0).uniform((-20, -20, 0), (20, 20, 2), (500, 3))
    image = queried_from(build_range_image(sweep().xyz_m, ORIGIN_M), sweep_T_frame)
    there = build_range_image(sweep().xyz_m, ORIGIN_M)
    assert np.array_equal(
        states_of(image, places.astype(np.float32), 0.5),
        states_of(there, sweep_T_frame.apply(places).astype(np.float32), 0.5),
    )


def test_the_fast_arctangent():
    angle = np.linspace(-np.pi, np.pi, 1001)
    found = [fast_atan2(np.sin(a), np.cos(a)) for a in angle[1:-1]]
    np.testing.assert_allclose(found, angle[1:-1], atol=2e-5)
