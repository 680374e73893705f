"""The map's picture: grey by evidence, colour by velocity."""

from __future__ import annotations

import numpy as np
import pytest

from mottrack.core.errors import InputError
from mottrack.core.pose import Pose
from mottrack.viz.dogma import EGO_COLOUR, MapPicture, draw_map, map_to_rgb


def picture(moving_col=3, size=8):
    occupied, free = np.zeros((2, size, size), np.float32)
    moving = np.zeros((size, size), bool)
    velocity = np.zeros((size, size, 2), np.float32)
    free[:, :2] = 1
    occupied[4, 4] = occupied[2, moving_col] = 1
    moving[2, moving_col] = True
    velocity[2, moving_col] = 10.0, 0.0
    pose = Pose.from_yaw(0.3, [1.0, 1.0, 0.0])
    return MapPicture(occupied, free, moving, velocity, (0.0, 0.0), 0.25, pose)


def test_free_is_white_unknown_grey_occupied_black_and_motion_coloured():
    rgb = map_to_rgb(picture())
    assert (rgb[0, 0] == 255).all()
    assert (rgb[4, 4] == 0).all()
    assert (rgb[7, 7] == 160).all()
    assert np.ptp(rgb[2, 3].astype(int)) > 50


def test_the_picture_has_north_up_and_the_vehicle_where_it_stands():
    size = 80
    drawn = draw_map(picture(moving_col=60, size=size), scale=3)
    assert drawn.shape == (240, 240, 3)
    row, col = 3 * (size - 1 - 2) + 1, 3 * 60 + 1
    assert np.ptp(drawn[row, col].astype(int)) > 50
    orange = (drawn == EGO_COLOUR).all(axis=-1)
    rows, cols = np.nonzero(orange)
    place_m = np.array([cols.mean(), 240 - rows.mean()]) * 0.25 / 3
    assert np.hypot(*(place_m - [1.0 + 1.3, 1.0 + 0.4])) < 0.8


def test_slow_cells_are_not_pale():
    slow = picture()
    slow.velocity_mps[2, 3] = 0.5, 0.0
    assert np.ptp(map_to_rgb(slow)[2, 3].astype(int)) > 50


def test_what_cannot_be_drawn_is_refused():
    good = picture()
    with pytest.raises(InputError, match="shape of moving"):
        MapPicture(good.occupied, good.free, good.moving[:4], good.velocity_mps, (0, 0), 0.25)
