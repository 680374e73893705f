"""The nuScenes reader: rates, interpolation, index, names that escape, real files."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import ConfigError, DataError
from mottrack.datasets.nuscenes import dataset as dataset_module
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.datasets.nuscenes.scene import chosen_sweeps
from mottrack.formats import cache
from mottrack.lidar.in_boxes import points_in_boxes


@pytest.fixture
def root(written_roots):
    return written_roots["nuscenes"]


@pytest.fixture
def editable(root, tmp_path):
    """The same tables in a folder of their own; sweeps are linked, not copied."""
    copy = tmp_path / "data"
    for path in root.rglob("*"):
        if path.is_file():
            target = copy / path.relative_to(root)
            target.parent.mkdir(parents=True, exist_ok=True)
            if path.suffix == ".bin":
                os.link(path, target)
            else:
                target.write_bytes(path.read_bytes())
    return copy


def scene_of(root, **options):
    dataset = NuScenes(NuScenesConfig(root=root, **options))
    return dataset.scene(dataset.scene_names[0])


def edit(root, table, change):
    path = root / "v1.0-trainval" / f"{table}.json"
    rows = json.loads(path.read_text())
    change(rows)
    path.write_text(json.dumps(rows, indent=0))
    return path


def test_every_second_sweep_is_counted_back_from_key_frames():
    sweep_sample = np.array([-1, -1, 0, -1, -1, -1, 1, -1, -1, 2, -1])
    assert chosen_sweeps(sweep_sample, 20).tolist() == list(range(10))
    assert chosen_sweeps(sweep_sample, 2).tolist() == [2, 6, 9]
    assert chosen_sweeps(sweep_sample, 10).tolist() == [0, 2, 4, 6, 7, 9]


def test_rates(root):
    rates = {rate: scene_of(root, rate_hz=rate) for rate in (2, 10, 20)}
    assert [len(rates[rate]) for rate in (2, 10, 20)] == [3, 11, 21]
    for scene in rates.values():
        assert sum(scene.frame(i).is_key for i in range(len(scene))) == 3
    assert rates[10].frame(1).stamp_ns - rates[10].frame(0).stamp_ns == 100_000_000


def test_truth_between_key_frames_is_interpolated_on_request(root):
    assert scene_of(root).frame(2).truth is None
    scene = scene_of(root, interpolate_truth=True)
    before, middle, after = (scene.frame(i) for i in (0, 2, 5))
    assert middle.truth.interpolated.all()
    assert not before.truth.interpolated.any()
    assert not middle.is_key
    share = (middle.stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    for row, identity in enumerate(middle.truth.id.tolist()):
        start = before.truth.centre_m[before.truth.id == identity][0]
        end = after.truth.centre_m[after.truth.id == identity][0]
        expected = start + share * (end - start)
        np.testing.assert_allclose(middle.truth.centre_m[row], expected, atol=1e-9)
        velocity = (end - start)[:2] / ((after.stamp_ns - before.stamp_ns) * 1e-9)
        np.testing.assert_allclose(middle.truth.velocity_mps[row], velocity, atol=1e-9)


def test_detections_hand_on_velocities_only_on_request(root):
    path = Path("detections/synthetic.json")
    assert scene_of(root, detections=path).frame(0).detections.velocity is None
    velocity = scene_of(root, detections=path, detector_velocity=True).frame(0).detections.velocity
    assert not velocity.valid.any()  # the embedded detector measures none and writes NaN
    assert scene_of(root).frame(0).detections is None


def test_detection_file_with_nan_velocity_is_read(root, tmp_path):
    content = json.loads((root / "detections/synthetic.json").read_text())
    first = next(token for token, boxes in content["results"].items() if boxes)
    for box in (box for boxes in content["results"].values() for box in boxes):
        box["velocity"] = [1.0, 0.0]
    content["results"][first][0]["velocity"] = [float("nan"), float("nan")]
    path = tmp_path / "detections.json"
    path.write_text(json.dumps(content))
    scene = scene_of(root, detections=path, detector_velocity=True, rate_hz=2)
    valid = [scene.frame(i).detections.velocity.valid for i in range(len(scene))]
    assert sum(int((~v).sum()) for v in valid) == 1


def test_detection_file_must_be_whole_for_a_scene(root, tmp_path):
    content = json.loads((root / "detections/synthetic.json").read_text())
    tokens = list(content["results"])
    path = tmp_path / "detections.json"
    del content["results"][tokens[1]]
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match=rf"results\[{tokens[1]}\] is missing"):
        scene_of(root, detections=path).frame(0)
    path.write_text(json.dumps(content | {"results": {"of another split": []}}))
    assert scene_of(root, detections=path).frame(0).detections is None
    path.write_text('{"meta": {}, "results": {"a": [], "a": []}}')
    with pytest.raises(DataError, match="expected each sample once"):
        scene_of(root, detections=path).frame(0)
    for damaged in ('{"meta": {}, "results": {"a": null}}', '{"meta": {}, "results": [{}]}'):
        path.write_text(damaged)
        with pytest.raises(DataError, match=r"detections\.json: (results|end of file) is"):
            scene_of(root, detections=path).frame(0)


def test_large_tables_are_indexed_once(root, tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "LARGE_BYTES", 0)
    whole = scene_of(root, cache=False)
    first = scene_of(root, cache_dir=tmp_path)
    built = list(tmp_path.rglob("*.npz"))
    assert len(built) == 1
    monkeypatch.setattr(dataset_module, "build_records", None)  # the index alone must do now
    again = scene_of(root, cache_dir=tmp_path)
    for scene in (first, again):
        np.testing.assert_array_equal(scene.frame(0).truth.centre_m, whole.frame(0).truth.centre_m)
        assert scene.frame(0).token == whole.frame(0).token
    monkeypatch.undo()
    monkeypatch.setattr(cache, "LARGE_BYTES", 0)
    built[0].write_bytes(built[0].read_bytes()[:-50])
    np.testing.assert_array_equal(
        scene_of(root, cache_dir=tmp_path).frame(0).truth.size_m, whole.frame(0).truth.size_m
    )


def test_a_sweep_outside_the_root_is_refused(editable):
    secret = editable.parent / "secret.bin"
    secret.write_bytes(np.ones(20, "<f4").tobytes())

    def escape(rows):
        rows[0]["filename"] = "../secret.bin"

    edit(editable, "sample_data", escape)
    with pytest.raises(DataError, match=r"path is \.\./secret\.bin, expected a path inside"):
        scene_of(editable, rate_hz=20).sweep(0)

    def link(rows):
        rows[0]["filename"] = "samples/link.bin"

    edit(editable, "sample_data", link)
    (editable / "samples/link.bin").symlink_to(secret)
    with pytest.raises(DataError, match="target inside the data root"):
        scene_of(editable, rate_hz=20).sweep(0)
    scene = scene_of(editable, rate_hz=20, follow_links=True, vehicle=None)
    assert len(scene.sweep(0)) == 4


FAULTS = {
    "missing pose": ("ego_pose", lambda rows: rows.pop(3), "ego_pose.json: record is missing"),
    "duplicate stamp": (
        "sample_data",
        lambda rows: rows[1].update(timestamp=rows[0]["timestamp"]),
        "sample_data.json: timestamp of record .* is 0, expected each time once",
    ),
    "no key frame": (
        "sample_data",
        lambda rows: rows[0].update(is_key_frame=False),
        "LIDAR_TOP key frames of sample",
    ),
    "text for a number": (
        "ego_pose",
        lambda rows: rows[0].update(translation=["1", "2", "3"]),
        "translation of record",
    ),
    "no unit quaternion": (
        "ego_pose",
        lambda rows: rows[0].update(rotation=[2.0, 0.0, 0.0, 0.0]),
        "rotation of record",
    ),
    "negative size": (
        "sample_annotation",
        lambda rows: rows[0].update(size=[1.0, -1.0, 1.0]),
        "size of record",
    ),
    "field gone": (
        "sample_annotation",
        lambda rows: rows[0].pop("translation"),
        "translation of record",
    ),
    "unknown instance": (
        "sample_annotation",
        lambda rows: rows[0].update({"instance_token": "nobody"}),
        "instance.json: record is missing, expected instance nobody",
    ),
    "an instance twice": (
        "sample_annotation",
        lambda rows: rows.append(rows[0] | {"token": "f" * 32}),
        "instance_token of record f+ is .*, expected each instance once a sample",
    ),
    "a scene name twice": (
        "scene",
        lambda rows: rows.append(rows[0] | {"token": "e" * 32}),
        "scene.json: name of record e+ is scene-.*, expected each name once",
    ),
    "huge place": (
        "ego_pose",
        lambda rows: rows[0].update(translation=[1e300, 0.0, 0.0]),
        r"translation of record .* is \[1e\+300.*, expected within 1e\+08 m",
    ),
    "late beyond nanoseconds": (
        "sample_data",
        lambda rows: rows[-1].update(timestamp=2**62),
        "sample_data.json: timestamp of record .* is 4611686018427387904, expected microseconds",
    ),
    "name outside the root": (
        "sample_data",
        lambda rows: rows[0].update(filename="../../x.bin"),
        "expected a path inside the data root",
    ),
    "no LiDAR": ("sensor", lambda rows: rows.clear(), "channel is missing, expected LIDAR_TOP"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(editable, fault):
    table, change, message = FAULTS[fault]
    edit(editable, table, change)
    with pytest.raises(DataError, match=message):
        _ = scene_of(editable, rate_hz=20).frame(0), scene_of(editable, rate_hz=20).has_sweeps


def test_splits_and_versions(root, editable, tmp_path):
    names = NuScenes(NuScenesConfig(root=root)).scene_names
    listed = tmp_path / "split.txt"
    listed.write_text("# mine\n" + "\n".join(names))
    assert NuScenes(NuScenesConfig(root=root, split=str(listed))).scene_names == names
    with pytest.raises(DataError, match="expected scenes of split train"):
        _ = NuScenes(NuScenesConfig(root=root, split="train")).scene_names
    with pytest.raises(ConfigError, match="unknown scene"):
        NuScenes(NuScenesConfig(root=root)).scene("scene-9999")
    (editable / "v1.0-mini").mkdir()
    with pytest.raises(DataError, match="version is not chosen"):
        NuScenes(NuScenesConfig(root=editable))


def test_real_sweep_of_scene_0061(shared_data):
    """65 of the 68 boxes of the first sample hold points, as the shared copy's README says."""
    root, names = shared_data / "nuscenes_mini", ("scene-0061",)
    assert len(scene_of(root, scenes=names, vehicle=None).sweep(0)) == 34_688
    scene = scene_of(root, scenes=names)
    frame, sweep = scene.frame(0), scene.sweep(0)
    assert len(sweep) == 26_162  # a quarter of the returns are the vehicle's own
    assert np.hypot(*sweep.xyz_m[:, :2].T).min() > 1.0
    ego = frame.truth.transformed(frame.world_T_ego.inverse(), "ego")
    found = points_in_boxes(sweep.xyz_m, ego.centre_m, ego.size_m, ego.yaw_rad)
    count = np.diff(found.start)
    assert (len(count), int((count > 0).sum())) == (68, 65)


def test_real_centerpoint_detections(shared_data):
    root = shared_data / "nuscenes_mini"
    scene = scene_of(
        root,
        split="mini_val",
        scenes=("scene-0103",),
        detections=Path("detections/centerpoint_scene-0103.json"),
    )
    boxes = [scene.frame(i).detections for i in range(len(scene))]
    assert (len(boxes), sum(map(len, boxes))) == (40, 5772)
