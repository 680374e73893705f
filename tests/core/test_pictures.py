"""What objects print and show in a notebook."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

import mottrack
from mottrack import BevGrid, FlowField, Objects, Tracks
from mottrack.core.pictures import png


def test_a_png_is_what_another_reader_sees() -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    np.testing.assert_array_equal(np.array(Image.open(io.BytesIO(png(rgb)))), rgb)


def test_objects_and_tracks_print_short_and_escape_their_labels() -> None:
    label = np.array(["<b>car", "<b>car", "bus"])
    boxes = {
        "stamp_ns": 1_500_000_000,
        "centre_m": np.eye(3),
        "size_m": np.ones((3, 3)),
        "yaw_rad": np.zeros(3),
        "label": label,
        "score": np.ones(3),
    }
    objects = Objects(**boxes)
    assert repr(objects) == (
        "Objects(2 <b>car, 1 bus at 1.500 s, world frame, 0 with a measured velocity)"
    )
    assert "<b>" not in objects._repr_html_()
    tracks = Tracks(
        **boxes,
        id=np.arange(3),
        velocity_mps=np.array([[3.0, 4.0], [0, 0], [1, 0]]),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (3, 1, 1)),
        state=np.zeros((3, 0)),
        covariance=np.zeros((3, 0, 0)),
        observed=np.ones(3, bool),
    )
    assert repr(tracks).endswith("up to 5.0 m/s)")
    assert tracks._repr_html_().count("<polygon") == 3
    assert "none at 0.000 s" in repr(Objects.empty(0))
    assert "<svg" in Tracks.empty(0)._repr_html_()


def test_a_flow_field_is_drawn_with_its_left_side_up() -> None:
    grid = BevGrid(-2, 2, -2, 2, 1.0)
    occupied = np.zeros(grid.shape, bool)
    occupied[3, 0] = True  # the last row is the left edge, the first column the rear
    field = FlowField.unmeasured(grid, occupied, 0)
    assert repr(field) == "FlowField(4 x 4 cells, 1 occupied, 0 measured)"
    import base64

    data = field._repr_html_().split("base64,")[1].split('"')[0]
    seen = np.array(Image.open(io.BytesIO(base64.b64decode(data))))
    assert (seen[0, 0] != 255).any()
    assert (seen[1:] == 255).all()


def test_every_public_name_is_there_and_listed() -> None:
    assert sorted(mottrack.__all__) == mottrack.__dir__() == mottrack.__all__
    for name in mottrack.__all__:
        assert getattr(mottrack, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Kalman'"):
        _ = mottrack.Kalman
