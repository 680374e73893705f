"""A scene seen from above: every key frame, hulls where there are hulls, a GIF and an MP4."""

from __future__ import annotations

import sys
from dataclasses import replace

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from mottrack.core.errors import ConfigError, InputError
from mottrack.viz.animation import write_animation
from mottrack.viz.bev import draw_bev, draw_key_frames, key_frame_period_s

HULL_M = np.array([[8.0, 3.0], [10.0, 3.0], [9.0, 5.0]])


def outlines(axes):
    return [
        segment
        for collection in axes.collections
        if isinstance(collection, LineCollection)
        for segment in collection.get_segments()
    ]


def test_a_track_with_a_hull_is_drawn_by_it_and_others_by_their_box(result, snapshot):
    axes = Figure().subplots()
    draw_bev(axes, result, snapshot, reach_m=20.0)
    truth, hull = outlines(axes)
    np.testing.assert_allclose(hull, [*HULL_M, HULL_M[0]], atol=1e-6)
    axes = Figure().subplots()
    draw_bev(axes, result, replace(snapshot, frame=2), reach_m=20.0)
    truth, track = outlines(axes)
    np.testing.assert_allclose(track, truth)
    np.testing.assert_allclose(track.mean(axis=0)[1], -3.0, atol=0.5)


def test_each_key_frame_has_a_picture(result, snapshot):
    pictures = list(draw_key_frames(result, [snapshot], reach_m=20.0))
    assert len(pictures) == 3
    assert {picture.shape for picture in pictures} == {(760, 760, 3)}
    near_the_cell = [picture[150:250, 350:500].astype(int) for picture in pictures]
    coloured = [int((np.ptp(part, axis=-1) > 60).sum()) for part in near_the_cell]
    assert coloured[1] > coloured[0]  # points and flow were kept of the middle one only
    assert key_frame_period_s(result) == 0.5


def stripes(count, size=32):
    for k in range(count):
        picture = np.full((size, size, 3), 255, np.uint8)
        picture[:, 4 * k : 4 * k + 4] = 200, 30, 30
        yield picture


def test_a_gif_keeps_pictures_colours_and_time(tmp_path):
    path = tmp_path / "new" / "scene.gif"
    assert write_animation(path, stripes(5), 0.2) == 5
    with Image.open(path) as image:
        assert (image.n_frames, image.size, image.info["duration"]) == (5, (32, 32), 200)
        image.seek(3)
        shown = np.asarray(image.convert("RGB")).astype(int)
    assert np.abs(shown[16, 13] - [200, 30, 30]).max() <= 2
    assert (shown[16, 20] == 255).all()


def test_an_mp4_plays_at_the_wanted_speed(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "scene.mp4"
    assert write_animation(path, stripes(5, size=33), 0.1) == 5
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (float(stream.average_rate), stream.width, stream.height) == (10.0, 32, 32)
        shown = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(stream)]
    assert len(shown) == 5
    assert shown[3][16, 13, 0] - shown[3][16, 13, 1] > 90  # still reddish where the stripe was


def test_what_cannot_be_written_is_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"ending of the animation is a\.png"):
        write_animation(tmp_path / "a.png", stripes(2), 0.1)
    with pytest.raises(InputError, match="period_s"):
        write_animation(tmp_path / "a.gif", stripes(2), 0.0)
    with pytest.raises(InputError, match="number of pictures"):
        write_animation(tmp_path / "a.gif", [], 0.1)
    two_sizes = [*stripes(1), *stripes(1, size=8)]
    with pytest.raises(InputError, match="size of a picture"):
        write_animation(tmp_path / "a.gif", two_sizes, 0.1)
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ConfigError, match=r"mottrack\[viz\]"):
        write_animation(tmp_path / "a.mp4", stripes(2), 0.1)
