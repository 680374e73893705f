"""Side by side: colours of moving cells, grey ones, and a figure of the promised shape."""

from __future__ import annotations

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest

from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.snapshot import Snapshot
from mottrack.viz.flow_comparison import STILL, UNMEASURED, FlowPanel, flow_comparison, flow_image

GRID = BevGrid(-5.0, 5.0, -5.0, 5.0, 0.5)


def field() -> FlowField:
    """One cell drives forward, one rests, one was not measured."""
    occupied = np.zeros(GRID.shape, np.bool_)
    occupied[10, [4, 10, 16]] = True
    nothing = FlowField.unmeasured(GRID, occupied, 0)
    velocity_mps, valid = np.zeros((*GRID.shape, 2), np.float32), occupied.copy()
    velocity_mps[10, 4] = 12.0, 0.0
    valid[10, 16] = False
    return FlowField(
        GRID, velocity_mps, nothing.covariance_m2ps2, occupied, valid, nothing.weight, 0
    )


def test_moving_is_coloured_and_grown_resting_grey_empty_white() -> None:
    image = flow_image(field(), 12.0)
    assert image[10, 4, 0] == 1.0  # forward is red
    assert image[10, 4, 1] < 0.3
    assert np.array_equal(image[9, 3], image[10, 4])
    assert (image[10, 10] == STILL).all()
    assert (image[9, 10] == 1.0).all()
    assert (image[10, 16] == UNMEASURED).all()


def test_a_field_and_its_snapshot_look_alike() -> None:
    kept = Snapshot.of(0, np.zeros((0, 3), np.float32), field(), None)
    assert np.array_equal(flow_image(kept, 12.0), flow_image(field(), 12.0))


def test_a_row_for_each_scene_and_titles_above_the_first() -> None:
    figure = flow_comparison(
        [[FlowPanel("truth", field()), FlowPanel("mine", field())]] * 3, reach_m=5.0
    )
    titled = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert len(figure.axes) == 6
    assert titled == ["truth", "mine"]
    with pytest.raises(InputError, match="same number"):
        flow_comparison([[FlowPanel("truth", field())], []])
