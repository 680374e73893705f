"""Clusters and fixed-lag smoothing in the whole pipeline, and each of them without the other."""

from __future__ import annotations

from functools import cache

import numpy as np

from mottrack.core import SceneResult
from mottrack.eval.velocity_error import velocity_samples, velocity_table
from mottrack.experiment.experiment import load_experiments
from mottrack.pipeline.scene_run import run_scene

WORLD = ("dataset.scenes=1", "dataset.seed=31", "dataset.duration_s=1.0", "dataset.key_hz=10")


@cache
def ran(*chosen: str) -> SceneResult:
    experiment = load_experiments("clusters", [*WORLD, *chosen])[0]
    dataset = experiment.dataset.make()
    return run_scene(experiment, dataset.scene(dataset.scene_names[0])).result


def mean_error_mps(result: SceneResult, row: str) -> float:
    return velocity_table([velocity_samples(result)])[row].mean_mps


def test_flow_settles_clusters() -> None:
    plain, aided = ran("flow=zero"), ran("flow=ground_truth")
    for result in (plain, aided):
        assert len(np.unique(result.tracks.id)) > 20
        assert set(result.tracks.label.tolist()) == {"generic"}
        assert all(len(hull) >= 3 for hull in result.hulls)
    for row in ("unlabelled tracks (assumed static)", "all"):
        assert mean_error_mps(aided, row) < 0.5 * mean_error_mps(plain, row)


def test_the_fixed_lag_tracker_runs_on_boxes() -> None:
    result = ran("flow=ground_truth", "objects=detections")
    assert len(result.tracks) > 50
    assert {"car", "pedestrian"} & set(result.tracks.label.tolist())
    assert not any(len(hull) for hull in result.hulls)
    assert mean_error_mps(result, "objects observed stationary") < 0.5


def test_the_kalman_tracker_runs_on_clusters_and_keeps_their_hulls() -> None:
    coast = "tracker.track_management.min_presence=0.1"
    result = ran("flow=ground_truth", "tracker=kalman", coast)
    tracks = result.tracks
    assert 0.5 < tracks.observed.mean() < 1.0  # coasting tracks carry their last hull
    off_m = [
        np.hypot(*(hull.mean(axis=0) - centre[:2]))
        for hull, centre in zip(result.hulls, tracks.centre_m, strict=True)
    ]
    assert np.median(off_m) < 0.5
    assert all(len(hull) >= 3 for hull in result.hulls)
