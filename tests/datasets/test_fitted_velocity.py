"""The fit of velocities through the boxes of a track."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mottrack.core.label_velocities import centred_velocities
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.argoverse2.dataset import Argoverse2
from mottrack.datasets.fitted_velocity import box_velocities
from mottrack.formats.columns import ColumnSpec, specs
from mottrack.formats.feather import read_feather_columns

LOGS = {"pandaset-002": "argoverse2", "pandaset-002b": "argoverse2_driving"}
UUID = ColumnSpec("track_uuid", str)


def fit(stamps_s, places_m, ids=None):
    stamps = np.round(np.asarray(stamps_s) * SECOND_NS).astype(np.int64)
    ids = np.zeros(len(stamps), np.int64) if ids is None else ids
    return box_velocities(ids, stamps, np.asarray(places_m, float), fitted=True)


@given(st.tuples(*[st.floats(-20, 20)] * 2), st.tuples(*[st.floats(-3, 3)] * 2), st.integers(9, 25))
def test_a_uniform_motion_is_exact_and_an_accelerated_one_nearly(v, a, frames):
    t = 0.1 * np.arange(frames)
    v, a = np.array(v), np.array(a)
    np.testing.assert_allclose(fit(t, 1e3 + v * t[:, None]), v[None].repeat(frames, 0), atol=1e-6)
    places = v * t[:, None] + 0.5 * a * t[:, None] ** 2
    error = np.abs(fit(t, places) - (v + a * t[:, None]))
    assert error[4:-4].max() < 0.05
    assert error.max() < 0.4  # at its ends a track has boxes on one side alone


def test_boxes_ahead_of_their_stamp_at_every_fifth_frame_are_outvoted():
    rng = np.random.default_rng(0)
    t = 0.1 * np.arange(40)
    places = np.column_stack([12.0 * t, 3.0 * t]) + rng.normal(0, 0.01, (40, 2))
    places[::5] += 0.05 * np.array([12.0, 3.0])
    stamps = np.round(t * SECOND_NS).astype(np.int64)
    centred = centred_velocities(np.zeros(40, np.int64), stamps, places)
    assert np.abs(centred - [12.0, 3.0])[6:-6].max() > 2.0
    assert np.abs(fit(t, places) - [12.0, 3.0])[6:-6].max() < 0.2


def test_at_two_hertz_it_is_the_centred_difference_and_long_gaps_stay_unknown():
    rng = np.random.default_rng(1)
    t, ids = np.concatenate([0.5 * np.arange(8), [20.0, 40.0]]), np.repeat([3, 9], [8, 2])
    places = rng.normal(0, 5, (10, 2))
    stamps = np.round(t * SECOND_NS).astype(np.int64)
    expected = centred_velocities(ids, stamps, places)
    np.testing.assert_allclose(fit(t, places, ids), expected, atol=2e-3)
    assert np.isnan(expected[-1]).all()


@pytest.mark.parametrize("log", LOGS)
def test_pandaset_agrees_with_fits_that_know_which_boxes_two_sensors_saw(log, shared_data):
    reference = read_feather_columns(
        shared_data / "pandaset_fitted_velocity" / f"{log}.feather",
        (
            ColumnSpec("timestamp_ns", int),
            ColumnSpec("track_uuid", str),
            *specs("vx_mps", "vy_mps"),
        ),
    )
    folder = shared_data / LOGS[log]
    names = np.unique(
        read_feather_columns(folder / "val" / log / "annotations.feather", (UUID,))["track_uuid"]
    )
    velocity = {}
    scene = Argoverse2(Argoverse2Config(root=folder)).scene(log)
    for index in range(len(scene)):
        truth = scene.frame(index).truth
        for row, identity in enumerate(truth.id):
            velocity[truth.stamp_ns, names[identity]] = truth.velocity_mps[row]
    keys = zip(reference["timestamp_ns"].tolist(), reference["track_uuid"], strict=True)
    ours = np.array([velocity[key] for key in keys])
    theirs = reference.stacked(("vx_mps", "vy_mps"))
    moving = np.hypot(*theirs.T) > 0.5
    difference = np.hypot(*(ours - theirs).T)[moving]
    # differences of neighbours: root mean square 0.35 and 0.47 m/s, 3 and 6 % over 1 m/s
    assert np.sqrt(np.mean(difference**2)) < 0.15
    assert difference.max() < 1.0
