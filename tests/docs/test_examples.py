"""The examples run and produce what the documentation says."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from mottrack import BevGrid, Pipeline, Pose, Sweep
from mottrack.experiment.experiment import load_to_stream
from mottrack.pipeline.scene_run import run_scene

from .conftest import REPOSITORY

EXAMPLES = REPOSITORY / "examples"


def test_streaming_prints_tracks_and_the_latency_of_each_stage() -> None:
    run = subprocess.run(
        [sys.executable, str(EXAMPLES / "stream.py"), "flow=zero"],
        check=True,
        capture_output=True,
        text=True,
    )
    *steps, head, _flow, ground, _objects, _velocity, _tracker, _total, summary = (
        run.stdout.splitlines()
    )
    assert len(steps) == 20
    assert all("tracks" in step for step in steps)
    assert head.split()[:4] == ["ms", "mean", "p50", "p99"]
    assert ground.split()[:3] == ["of", "it", "ground"]
    assert summary.startswith("budget 100 ms: ")


@pytest.fixture
def own_flow(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.delitem(sys.modules, "own_flow", raising=False)
    import own_flow

    return own_flow


def test_a_custom_flow_source_is_loaded_by_name(own_flow) -> None:
    world = ["dataset.scenes=1", "dataset.duration_s=1", "dataset.key_hz=5"]
    chosen = ["flow=own_flow:BlobFlow", "flow.reach_m=4"]
    experiment = load_to_stream("demo", [*world, *chosen])
    assert experiment.resolved()["flow"] == {"kind": "own_flow:BlobFlow", "reach_m": 4}
    dataset = experiment.dataset.make()
    run = run_scene(experiment, dataset.scene(dataset.scene_names[0]), keep_snapshots=False)
    assert run.result.flow.valid.mean() > 0.3
    assert isinstance(Pipeline(experiment).flow, own_flow.BlobFlow)


def test_a_custom_flow_source_measures_a_shift_and_accepts_empty_sweeps(own_flow) -> None:
    corners = np.stack(np.meshgrid(np.arange(0, 4, 0.2), np.arange(0, 2, 0.2), [1.0]), -1)
    block = corners.reshape(-1, 3)

    def sweep(points: np.ndarray, stamp_ns: int) -> Sweep:
        return Sweep(points, np.zeros(len(points)), stamp_ns, Pose.identity())

    before, after = (
        sweep(block + np.array([5.1, 3.1, 0]), 0),
        sweep(block + np.array([6.1, 3.1, 0]), 2 * 10**8),
    )
    field = own_flow.BlobFlow(grid=BevGrid()).estimate([before], after)
    np.testing.assert_allclose(field.velocity_mps[field.valid].mean(axis=0), [5.0, 0.0], atol=0.01)
    assert (field.valid == field.occupied).all()
    nothing = sweep(np.zeros((0, 3)), 10**8)
    assert not own_flow.BlobFlow(grid=BevGrid()).estimate([before], nothing).valid.any()
    assert not own_flow.BlobFlow(grid=BevGrid()).estimate([nothing], after).valid.any()


def test_own_detections_become_a_submission(tmp_path) -> None:
    out = tmp_path / "submission.json"
    program = [sys.executable, str(EXAMPLES / "track_own_detections.py")]
    subprocess.run([*program, str(EXAMPLES / "detections.csv"), str(out)], check=True)
    results = json.loads(out.read_text("utf-8"))["results"]
    assert len(results) == 12
    last = {box["tracking_id"]: box for box in results["sample-11"]}
    speeds = sorted(float(np.hypot(*box["velocity"])) for box in last.values())
    np.testing.assert_allclose(speeds, [0.0, 1.4, 8.0], atol=0.5)  # as the file was made
    assert {box["tracking_id"] for box in results["sample-5"]} == set(last)


def test_a_custom_tracker_and_object_source_are_loaded_by_name(monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    world = ["dataset.scenes=1", "dataset.duration_s=2", "flow=zero"]
    chosen = ["objects=own_radar:RadarBoxes", "tracker=own_tracker:NearestTracker"]
    experiment = load_to_stream("demo", [*world, *chosen, "tracker.reach_m=4"])
    dataset = experiment.dataset.make()
    scene = dataset.scene(dataset.scene_names[0])
    pipeline = Pipeline(experiment)
    steps = [pipeline.step(scene.frame(k), scene.sweep(k)) for k in range(len(scene))]
    keys = [step for step in steps if step.tracks is not None]
    measured = keys[-1].objects.velocity
    assert measured.valid.any()
    seen = keys[-1].tracks.velocity_mps[measured.valid]
    np.testing.assert_allclose(seen, measured.mean_mps[measured.valid])
    assert np.isin(keys[-1].tracks.id, keys[-2].tracks.id).mean() > 0.5
