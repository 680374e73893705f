"""Point-wise flow of a scene: direction, ego motion, what counts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import Frame, InputError, Sweep
from mottrack.core.arrays import Mask
from mottrack.eval.sceneflow.figures import SceneSums
from mottrack.eval.sceneflow.points import FlowPoints
from mottrack.eval.sceneflow.sums import frame_sums, total
from mottrack.experiment.experiment import load_experiments
from mottrack.pipeline.mirrored import MirroredScene
from mottrack.pipeline.scene_flow import scene_flow_points
from mottrack.pipeline.scene_run import run_scene

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


class Backwards(MirroredScene):
    """A scene from its end, with what the main loop asks of a scene."""

    classes = ()
    has_sweeps = True

    @property
    def name(self) -> str:
        return self.scene.name


@pytest.mark.parametrize("flow", ["zero", "ground_truth"])
def test_a_run_of_the_reversed_scene_has_the_figures_of_the_challenge(flow: str) -> None:
    """A run compares the motion since the frame before, which backwards is that to the next."""
    experiment = load_experiments("demo", [f"flow={flow}", "tracker=kalman", *WORLD])[0]
    dataset = experiment.dataset.make()
    scene = dataset.scene(dataset.scene_names[0])
    samples = scene_flow_points(experiment, scene)
    challenge = SceneSums((total([frame_sums(s.points) for s in samples]),)).values()
    run = run_scene(experiment, Backwards(scene), keep_snapshots=False)
    assert run.scene_flow is not None
    found = SceneSums((run.scene_flow,)).values()
    assert found.keys() == challenge.keys()
    for key, value in challenge.items():
        assert found[key] == pytest.approx(value, rel=1e-9, abs=1e-9, nan_ok=True), key


def test_frames_without_annotations_are_predicted_where_masks_name_them() -> None:
    experiment = load_experiments("demo", ["flow=ground_truth", *WORLD])[0]
    dataset = experiment.dataset.make()
    scene = dataset.scene(dataset.scene_names[0])
    wanted = scene.frame(4).stamp_ns

    class Unlabelled(Backwards):
        def __len__(self) -> int:
            return len(self.scene)

        def frame(self, index: int) -> Frame:
            return replace(self.scene.frame(index), truth=None)

        def sweep(self, index: int) -> Sweep:
            return self.scene.sweep(index)

    def every_third(_: str, stamp_ns: int) -> Mask | None:
        count = len(scene.sweep(4))
        return np.arange(count) % 3 == 0 if stamp_ns == wanted else None

    (sample,) = scene_flow_points(experiment, Unlabelled(scene), every_third)
    assert sample.stamp_ns == wanted
    assert len(sample.points.valid) == -(-len(scene.sweep(4)) // 3)
    assert not sample.points.valid.any()  # nothing is known there
    assert sample.points.estimate_m[:, 0].min() < -0.1  # the vehicle's own motion
    with pytest.raises(InputError, match="the points of the sweep"):
        scene_flow_points(experiment, scene, lambda *_: np.ones(5, np.bool_))
