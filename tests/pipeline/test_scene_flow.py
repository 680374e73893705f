"""Point-wise flow of a scene: direction, ego motion, what counts."""

from pathlib import Path

import numpy as np
import pytest

from mottrack.eval.sceneflow.figures import SceneSums
from mottrack.eval.sceneflow.points import FlowPoints
from mottrack.eval.sceneflow.sums import frame_sums, total
from mottrack.experiment.experiment import load_experiments
from mottrack.pipeline.mirrored import MirroredScene
from mottrack.pipeline.scene_flow import scene_flow_points

WORLD = ("dataset.scenes=1", "dataset.duration_s=1", "dataset.key_hz=10")


def points_with(*overrides: str) -> list[FlowPoints]:
    experiment = load_experiments("demo", overrides)[0]
    dataset = experiment.dataset.make()
    scene = dataset.scene(dataset.scene_names[0])
    return [sample.points for sample in scene_flow_points(experiment, scene)]


def test_truth_as_a_source_points_forwards() -> None:
    """With the sign or the direction of time wrong the error would be 2 or the ego motion."""
    points = points_with("flow=ground_truth", *WORLD)
    values = SceneSums((total([frame_sums(p) for p in points]),)).values()
    assert len(points) == 9
    assert values["bucketed", "mean dynamic"] < 0.1
    assert values["threeway", "mean"] < 0.02
    moving = np.concatenate([p.dynamic for p in points])
    assert 0 < moving.sum() < moving.size


def test_rest_as_a_source_errs_by_the_motion_itself() -> None:
    points = points_with("flow=zero", *WORLD)
    values = SceneSums((total([frame_sums(p) for p in points]),)).values()
    assert values["bucketed", "mean dynamic"] == pytest.approx(1.0)
    assert values["threeway", "background static"] == pytest.approx(0.0, abs=1e-12)


def test_recorded_argoverse_log(shared_data: Path) -> None:
    """The vehicle drives at 1.3 to 3.4 m/s: at rest a point moves by that, backwards."""
    root = shared_data / "argoverse2_driving"
    data = ("dataset={kind: argoverse2, root: " + str(root) + ", frames: 4}",)
    points = points_with(*data, "flow=ground_truth")
    assert len(points) == 3
    for p in points:
        assert p.ego_motion_m is not None
        assert -0.4 < np.median(p.ego_motion_m[:, 0]) < -0.1
    values = SceneSums((total([frame_sums(p) for p in points]),)).values()
    assert values["bucketed", "mean dynamic"] < 0.15


def test_mirrored_scene_keeps_frames_and_turns_time() -> None:
    experiment = load_experiments("demo", ["flow=zero", *WORLD])[0]
    dataset = experiment.dataset.make()
    scene = dataset.scene(dataset.scene_names[0])
    mirrored = MirroredScene(scene)
    stamps = [mirrored.frame(i).stamp_ns for i in range(len(mirrored))]
    assert (
        np.diff(stamps).tolist()
        == np.diff([scene.frame(i).stamp_ns for i in range(10)])[::-1].tolist()
    )
    last = len(scene) - 1
    np.testing.assert_array_equal(mirrored.sweep(0).xyz_m, scene.sweep(last).xyz_m)
    truth, turned = scene.frame(3).truth, mirrored.frame(last - 3).truth
    assert truth is not None
    assert turned is not None
    np.testing.assert_array_equal(turned.velocity_mps, -truth.velocity_mps)
