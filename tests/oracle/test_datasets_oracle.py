"""The official nuScenes devkit reads what we write, and finds in it what we read.

Runs in an environment of its own: `make oracle`.
"""

import numpy as np
import pytest

pytest.importorskip("nuscenes", reason="needs nuscenes-devkit: make oracle")
from nuscenes.eval.common.config import config_factory
from nuscenes.eval.common.loaders import load_prediction
from nuscenes.eval.detection.data_classes import DetectionBox
from nuscenes.eval.tracking.evaluate import TrackingEval
from nuscenes.nuscenes import NuScenes as Devkit
from nuscenes.utils.data_classes import LidarPointCloud
from nuscenes.utils.geometry_utils import points_in_box
from nuscenes.utils.splits import create_splits_scenes
from pyquaternion import Quaternion

from mottrack.core import FlowSamples, FrameTable, SceneResult, TrackTable, TruthTable
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.datasets.nuscenes.submission import write_submission
from mottrack.datasets.synthetic import SyntheticConfig
from mottrack.datasets.writers import FORMATS, write_synthetic
from mottrack.eval.nuscenes.command import Request, run
from mottrack.formats.nuscenes_classes import CLASSES
from mottrack.formats.nuscenes_splits import split_scenes
from mottrack.lidar.in_boxes import points_in_boxes

VERSION = "v1.0-trainval"


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("nuscenes") / "data"
    world = SyntheticConfig(scenes=2, seed=5, duration_s=5.0)
    write_synthetic(folder, "nuscenes", world)
    return folder


@pytest.fixture(scope="module")
def devkit(root):
    return Devkit(version=VERSION, dataroot=str(root), verbose=False)


@pytest.fixture(scope="module")
def ours(root):
    return NuScenes(NuScenesConfig(root=root, split="val", rate_hz=20, vehicle=None))


def test_official_splits():
    for name, scenes in create_splits_scenes().items():
        assert sorted(split_scenes(name)) == sorted(scenes)


def test_devkit_sees_the_same_scenes_and_sweeps(devkit, ours, root):
    assert [scene["name"] for scene in devkit.scene] == list(ours.scene_names)
    for record in devkit.scene:
        scene = ours.scene(record["name"])
        keys = [i for i in range(len(scene)) if scene.frame(i).is_key]
        token = record["first_sample_token"]
        for index in keys:
            frame, sweep = scene.frame(index), scene.sweep(index)
            assert frame.token == token
            sample = devkit.get("sample", token)
            data = devkit.get("sample_data", sample["data"]["LIDAR_TOP"])
            assert data["timestamp"] * 1000 == frame.stamp_ns
            points = LidarPointCloud.from_file(str(root / data["filename"]))
            mount = devkit.get("calibrated_sensor", data["calibrated_sensor_token"])
            points.rotate(Quaternion(mount["rotation"]).rotation_matrix)
            points.translate(np.array(mount["translation"]))
            np.testing.assert_allclose(points.points[:3].T, sweep.xyz_m, atol=2e-5)
            pose = devkit.get("ego_pose", data["ego_pose_token"])
            rotation = Quaternion(pose["rotation"]).rotation_matrix
            np.testing.assert_allclose(rotation, frame.world_T_ego.rotation, atol=1e-12)
            token = sample["next"]
        assert token == ""


def test_devkit_sees_the_same_boxes(devkit, ours):
    total = 0
    for record in devkit.scene:
        scene = ours.scene(record["name"])
        for index in range(len(scene)):
            frame = scene.frame(index)
            if not frame.is_key:
                continue
            sample = devkit.get("sample", frame.token)
            boxes = [devkit.get_box(token) for token in sample["anns"]]
            found = {tuple(np.round(b.center, 6)): b for b in boxes}
            assert len(found) == len(frame.truth)
            for i, centre in enumerate(frame.truth.centre_m):
                box = found[tuple(np.round(centre, 6))]
                np.testing.assert_allclose(box.wlh[[1, 0, 2]], frame.truth.size_m[i])
                turn = box.orientation.yaw_pitch_roll[0] - frame.truth.yaw_rad[i]
                assert abs((turn + np.pi) % (2 * np.pi) - np.pi) < 1e-9
                velocity = devkit.box_velocity(box.token)[:2]
                np.testing.assert_allclose(frame.truth.velocity_mps[i], velocity, atol=1e-9)
            xyz = frame.world_T_ego.apply(scene.sweep(index).xyz_m)
            truth = frame.truth
            boxes = (truth.centre_m, truth.size_m, truth.yaw_rad)
            count = np.diff(points_in_boxes(xyz, *boxes).start)
            path, near, _ = devkit.get_sample_data(sample["data"]["LIDAR_TOP"])
            points = LidarPointCloud.from_file(path).points[:3]
            official = sorted(int(points_in_box(box, points).sum()) for box in near)
            np.testing.assert_allclose(np.sort(count), official, atol=1)
            total += sum(official)
    assert total > 1000


def test_devkit_loads_the_detections(root, ours):
    path = root / FORMATS["nuscenes"].detections
    boxes, meta = load_prediction(str(path), 500, DetectionBox)
    assert meta["use_lidar"]
    assert len(boxes.sample_tokens) == sum(
        scene.frame(i).is_key
        for scene in map(ours.scene, ours.scene_names)
        for i in range(len(scene))
    )
    assert len(boxes.all) > 100


def noisy_result(scene, seed):
    """The truth as tracks, with noise, gaps, swapped identities and telling scores."""
    rng = np.random.default_rng(seed)
    frames = [f for f in map(scene.frame, range(len(scene))) if f.is_key]
    truth = TruthTable.of(frames)
    kept = truth.select(np.isin(truth.label, CLASSES) & (rng.random(len(truth)) < 0.85))
    count = len(kept)
    known = np.nan_to_num(kept.velocity_mps)
    identity = np.where(rng.random(count) < 0.03, kept.id + 1000, kept.id)
    _, first = np.unique(np.column_stack([kept.frame, identity]), axis=0, return_index=True)
    tracks = TrackTable(
        frame=kept.frame,
        id=identity,
        label=kept.label,
        centre_m=kept.centre_m + rng.normal(0, 0.4, (count, 3)),
        size_m=kept.size_m,
        yaw_rad=kept.yaw_rad,
        velocity_mps=known,
        velocity_covariance_m2ps2=np.tile(np.eye(2), (count, 1, 1)),
        score=np.round(rng.beta(4, 2, count), 3),
        observed=np.ones(count, dtype=bool),
        hull_corners=np.zeros(count, dtype=np.int64),
    ).select(np.sort(first))
    return SceneResult(scene.name, FrameTable.of(frames), truth, tracks, FlowSamples.empty())


def test_tracking_eval_accepts_the_submission_and_agrees(root, ours, tmp_path):
    results = [noisy_result(ours.scene(name), i) for i, name in enumerate(ours.scene_names)]
    path = tmp_path / "submission.json"
    assert write_submission(path, results) > 200
    official = TrackingEval(
        config=config_factory("tracking_nips_2019"),
        result_path=str(path),
        eval_set="val",
        output_dir=str(tmp_path / "official"),
        nusc_version=VERSION,
        nusc_dataroot=str(root),
        verbose=False,
    ).main(render_curves=False)
    split = tmp_path / "split.txt"
    split.write_text("\n".join(ours.scene_names))
    ours_total = run(Request(root, VERSION, str(split), path)).metrics.total
    shared = official.keys() & ours_total.keys()
    assert {"amota", "amotp", "mota", "motp", "recall", "ids", "frag", "tid", "lgd"} <= shared
    for name in shared:
        assert ours_total[name] == pytest.approx(official[name], abs=1e-9, nan_ok=True), name
    assert 0.2 < official["amota"] < 1.0
