"""What a sweep could see, in a room with one wall."""

from __future__ import annotations

import numpy as np

from mottrack.core.grid import BevGrid
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.lidar.range_image import HIDDEN, HIT, PASSED, build_range_image, seen_before
from mottrack.lidar.visibility import FREE, OCCUPIED, UNSEEN, visibility_raster

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
    seen = visibility_raster(sweep(), wall, grid)
    rows, cols, _ = grid.cells(np.array([[5.0, 0.0], [15.0, 0.0], [10.0, 0.1], [-20.0, 3.0]]))
    assert seen[rows, cols].tolist() == [FREE, UNSEEN, OCCUPIED, FREE]


def test_a_point_is_passed_hit_or_hidden():
    image = build_range_image(wall_ahead(), ORIGIN_M)
    points = np.array([[5, 0, 1.0], [10.1, 0, 1.0], [14, 0, 1.0], [5, 0, 3.5]], np.float32)
    # above the rays that came back nothing is known
    assert seen_before(image, points).tolist() == [PASSED, HIT, HIDDEN, HIDDEN]
