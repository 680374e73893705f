"""The map's picture: grey by evidence, colour by velocity, and a GIF that can be read back."""

from __future__ import annotations

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from mottrack.core.errors import InputError
from mottrack.core.pose import Pose
from mottrack.viz.dogma import MapPicture, draw_map, map_to_rgb, save_gif


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


def test_drawing_in_world_axes():
    axes = Figure().subplots()
    draw_map(axes, picture(), arrows_every=1)
    assert axes.images[0].get_extent() == [0.0, 2.0, 0.0, 2.0]


def test_a_gif_of_a_scene(tmp_path):
    path = tmp_path / "map.gif"
    save_gif([picture(col) for col in (3, 4, 5)], path)
    with Image.open(path) as image:
        assert image.n_frames == 3
        assert image.size == (16, 16)
        assert image.info["duration"] == 100


def test_what_cannot_be_drawn_is_refused(tmp_path):
    with pytest.raises(InputError, match="sizes of pictures"):
        save_gif([], tmp_path / "none.gif")
    with pytest.raises(InputError, match="sizes of pictures"):
        save_gif([picture(), picture(size=9)], tmp_path / "two.gif")
    good = picture()
    with pytest.raises(InputError, match="shape of moving"):
        MapPicture(good.occupied, good.free, good.moving[:4], good.velocity_mps, (0, 0), 0.25)
