"""What a velocity is worth: common rows, ages, predictions and shares against hand-made tracks."""

from __future__ import annotations

import numpy as np
import pytest

from mottrack.core import SceneResult
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.eval.paired import MetricKey, draw
from mottrack.eval.velocity_error import VelocityErrorConfig
from mottrack.eval.velocity_value import headroom, value_metrics

FRAMES, STEP_S, SPEED = 6, 0.5, 5.0
CONFIG = VelocityErrorConfig()
ERROR = MetricKey("value", "all", "velocity error")


def scene(error_mps: float, absent: tuple[int, ...] = (), number: int = 0) -> SceneResult:
    """One car that drives along x, tracked with this error of its velocity, but for some frames."""
    frames = np.arange(FRAMES)
    centre = np.column_stack([SPEED * STEP_S * frames, np.zeros(FRAMES), np.zeros(FRAMES)])
    shared = {
        "label": np.full(FRAMES, "car"),
        "size_m": np.tile([4.5, 1.9, 1.6], (FRAMES, 1)),
        "yaw_rad": np.zeros(FRAMES),
        "centre_m": centre,
        "frame": frames,
        "id": np.ones(FRAMES, np.int64),
    }
    truth = TruthTable(
        **shared,
        velocity_mps=np.tile([SPEED, 0.0], (FRAMES, 1)),
        num_points=np.full(FRAMES, 9),
        interpolated=np.zeros(FRAMES, bool),
    )
    tracks = TrackTable(
        **shared,
        velocity_mps=np.tile([SPEED - error_mps, 0.0], (FRAMES, 1)),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (FRAMES, 1, 1)),
        score=np.full(FRAMES, 0.9),
        observed=np.ones(FRAMES, bool),
        hull_corners=np.zeros(FRAMES, np.int64),
    ).select(~np.isin(frames, absent))
    table = FrameTable(
        stamp_ns=(frames * STEP_S * 1e9).astype(np.int64),
        token=np.full(FRAMES, ""),
        world_T_ego=np.tile(np.eye(4), (FRAMES, 1, 1)),
        labelled_azimuth_rad=np.tile([-np.pi, np.pi], (FRAMES, 1)),
        annotated=np.ones(FRAMES, bool),
    )
    return SceneResult(f"scene {number}", table, truth, tracks)


def metrics(**runs: list[SceneResult]):
    weights = draw(len(next(iter(runs.values()))), 50)
    return value_metrics(runs, CONFIG, weights)


def test_rows_are_those_that_every_run_has() -> None:
    """A run that tracks less is not compared on what the others track as well."""
    good, bad = scene(1.0), scene(2.0, absent=(0, 1))
    late = scene(9.0)
    late = SceneResult(
        late.name, late.frames, late.truth, late.tracks.select(late.tracks.frame >= 2)
    )
    found = metrics(a=[good], b=[bad], c=[late])
    assert [found[run][ERROR].value for run in "abc"] == pytest.approx([1.0, 2.0, 9.0])
    age = MetricKey("value", "age 1", "velocity error")
    assert age not in found["a"]  # in frame 2 the first run's track is three frames old
    assert MetricKey("value", "age 1", "velocity error") in metrics(b=[bad], c=[late])["b"]


def test_a_prediction_misses_by_the_error_of_the_velocity() -> None:
    key = MetricKey("value", "fast", "1 s prediction")
    found = metrics(a=[scene(1.5)])["a"][key]
    assert found.value == pytest.approx(1.5)
    slow = scene(0.0)
    moves = slow.truth.select(slow.truth.frame == 0)  # alone: nobody knows where it is in a second
    alone = SceneResult(slow.name, slow.frames, moves, slow.tracks.select(slow.tracks.frame == 0))
    assert key not in metrics(a=[alone])["a"]


def test_the_share_of_the_headroom() -> None:
    errors = {"none": (2.0, 3.0, 4.0), "flow": (1.0, 1.5, 2.0), "truth": (0.0, 0.0, 0.0)}
    runs = {
        title: [scene(error, number=k) for k, error in enumerate(values)]
        for title, values in errors.items()
    }
    found = {title: figures[ERROR] for title, figures in metrics(**runs).items()}
    share = headroom("velocity error", found["none"], found["flow"], found["truth"])
    assert share is not None
    assert share.share == pytest.approx(0.5)
    assert share.low == pytest.approx(0.5)  # half in each scene, so half in every resample
    assert headroom("velocity error", found["none"], found["flow"], found["none"]) is None
