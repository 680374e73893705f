"""Detections of any data set out of tables and of detectors' exports."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import MottrackError, Pose
from mottrack.core.pose import wrap_angle
from mottrack.datasets.kitti.boxes import EgoBoxes, ego_to_camera
from mottrack.datasets.kitti.write import CAMERA_T_EGO, KIND_OF
from mottrack.datasets.scene_frames import key_frames
from mottrack.formats.box_table import PLACE, SIZE, write_box_rows
from mottrack.formats.detector_exports import read_export
from tests.datasets.makers import maker, open_dataset

SCRIPT = Path(__file__).parents[2] / "examples/unpickle_detections.py"
CLASSES = ("car", "truck", "bus", "trailer", "pedestrian", "bicycle", "motorcycle", "cyclist")
WRITTEN_M = 2e-6
"""The small data sets are written with six decimals at least."""


@pytest.fixture(scope="module")
def root_of(tmp_path_factory):
    roots: dict[str, Path] = {}

    def root(kind: str) -> Path:
        if kind not in roots:
            roots[kind] = tmp_path_factory.mktemp(kind)
            maker(kind).write(roots[kind])
        return roots[kind]

    return root


def found_in(dataset):
    """Yield name of the scene, token and detections, ego frame, of every key frame."""
    for name in dataset.scene_names:
        for frame in key_frames(dataset.scene(name)):
            yield name, frame, frame.detections.transformed(frame.world_T_ego.inverse(), "ego")


def in_lidar(boxes, ego_T_lidar):
    """Return (N, 7) x, y, z, l, w, h, heading in the LiDAR's frame."""
    centre = ego_T_lidar.inverse().apply(boxes.centre_m)
    yaw = wrap_angle(boxes.yaw_rad - ego_T_lidar.yaw_rad)
    return np.column_stack([centre, boxes.size_m, yaw])


def write_table(path: Path, dataset) -> Path:
    parts = list(found_in(dataset))
    values = np.concatenate(
        [np.column_stack([b.centre_m, b.size_m, b.yaw_rad]) for _, _, b in parts]
    )
    columns = {
        "scene": np.concatenate([np.full(len(b), name) for name, _, b in parts]),
        "stamp_ns": np.concatenate([np.full(len(b), frame.stamp_ns) for _, frame, b in parts]),
        "label": np.concatenate([b.label for _, _, b in parts]),
        "score": np.concatenate([b.score for _, _, b in parts]),
        **{name: values[:, i] for i, name in enumerate((*PLACE, *SIZE, "yaw"))},
    }
    write_box_rows(path, columns)
    return path


def openpcdet_entries(dataset, ego_T_lidar, names):
    return [
        {
            "frame_id": names(scene, frame),
            "name": boxes.label,
            "score": boxes.score,
            "boxes_lidar": in_lidar(boxes, ego_T_lidar),
        }
        for scene, frame, boxes in found_in(dataset)
    ]


def write_openpcdet(path: Path, entries) -> Path:
    plain = [
        {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in e.items()} for e in entries
    ]
    path.write_text(json.dumps(plain))
    return path


def write_mmdet3d(folder: Path, dataset) -> Path:
    for scene, frame, boxes in found_in(dataset):
        values = in_lidar(boxes, Pose.identity())
        values[:, 2] -= values[:, 5] / 2
        content = {
            "labels_3d": [CLASSES.index(label) for label in boxes.label],
            "scores_3d": boxes.score.tolist(),
            "bboxes_3d": values.tolist(),
            "box_type_3d": "LiDAR",
        }
        path = folder / scene / f"{frame.token}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content))
    return folder / "{scene}"


def write_kitti_objects(folder: Path, dataset) -> Path:
    for scene, frame, boxes in found_in(dataset):
        camera = ego_to_camera(
            EgoBoxes(boxes.centre_m, boxes.size_m, boxes.yaw_rad), CAMERA_T_EGO.inverse()
        )
        lines = []
        for i in range(len(boxes)):
            numbers = [*camera.size_hwl_m[i], *camera.bottom_m[i], camera.ry_rad[i], boxes.score[i]]
            kind = KIND_OF[str(boxes.label[i])]
            lines.append(f"{kind} -1 -1 0 1 2 3 4 {' '.join(f'{v:.9f}' for v in numbers)}\n")
        path = folder / scene / f"{frame.token}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(lines))
    return folder / "{scene}"


def unpickled(tmp_path: Path, entries, *options: str):
    source, out = tmp_path / "result.pkl", tmp_path / "out.npz"
    source.write_bytes(entries if isinstance(entries, bytes) else pickle.dumps(entries))
    command = [sys.executable, str(SCRIPT), str(source), str(out), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False), out


def write_npz(tmp_path: Path, dataset) -> Path:
    entries = openpcdet_entries(dataset, Pose.identity(), lambda s, f: f"{s}/{f.token}")
    done, out = unpickled(tmp_path, entries)
    assert done.returncode == 0, done.stderr
    return out


WRITERS = {
    "csv": lambda tmp, dataset: write_table(tmp / "d.csv", dataset),
    "parquet": lambda tmp, dataset: write_table(tmp / "d.parquet", dataset),
    "OpenPCDet": lambda tmp, dataset: write_openpcdet(
        tmp / "d.json",
        openpcdet_entries(dataset, Pose.identity(), lambda s, f: f"{s}/{f.token}"),
    ),
    "MMDetection3D": lambda tmp, dataset: write_mmdet3d(tmp / "preds", dataset),
    "KITTI objects": lambda tmp, dataset: write_kitti_objects(tmp / "objects", dataset),
    "npz": write_npz,
}


@pytest.mark.parametrize("kind", ["folder", "kitti", "argoverse2"])
@pytest.mark.parametrize("form", WRITERS)
def test_every_form_gives_the_detections_of_the_data_sets_own(root_of, tmp_path, form, kind):
    if form == "KITTI objects" and kind != "kitti":
        return  # in the frame of KITTI's camera
    root = root_of(kind)
    own = open_dataset(kind, root)
    path = WRITERS[form](tmp_path, own)
    detector = {"classes": list(CLASSES)}
    read = open_dataset(kind, root, detections=str(path), detector=detector)
    compare(own, read)


def compare(own, read):
    count = 0
    for name in own.scene_names:
        frames = [list(key_frames(data.scene(name))) for data in (own, read)]
        for a, b in zip(*frames, strict=True):
            first, second = (
                o.select(np.lexsort(np.round(o.centre_m, 4).T))
                for o in (a.detections, b.detections)
            )
            count += len(first)
            assert first.label.tolist() == second.label.tolist()
            for field in ("centre_m", "size_m", "score"):
                ours, theirs = getattr(first, field), getattr(second, field)
                np.testing.assert_allclose(theirs, ours, atol=WRITTEN_M)
            turned = wrap_angle(second.yaw_rad - first.yaw_rad)
            np.testing.assert_allclose(turned, 0.0, atol=WRITTEN_M)
    assert count


@pytest.mark.parametrize("name", ["token", "file"])
def test_boxes_in_the_lidars_frame_are_mounted_on_nuscenes(root_of, tmp_path, name):
    """OpenPCDet's are in LIDAR_TOP's axes, x to the right; frames are samples or cloud files."""
    root = root_of("nuscenes")
    own = open_dataset("nuscenes", root, rate_hz=2)
    tables = root / "v1.0-trainval"
    rows = json.loads((tables / "sample_data.json").read_text())
    stems = {r["sample_token"]: Path(r["filename"]).name for r in rows if r["is_key_frame"]}
    mounts = json.loads((tables / "calibrated_sensor.json").read_text())
    lidar = {r["token"]: r["channel"] for r in json.loads((tables / "sensor.json").read_text())}
    mount = next(m for m in mounts if lidar[m["sensor_token"]] == "LIDAR_TOP")
    ego_T_lidar = Pose.from_quaternion_wxyz(mount["rotation"], mount["translation"])
    assert np.abs(ego_T_lidar.rotation - np.eye(3)).max() > 0.5  # turned by a quarter

    def named(_scene, frame):
        return frame.token if name == "token" else stems[frame.token].removesuffix(".bin")

    path = write_openpcdet(tmp_path / "d.json", openpcdet_entries(own, ego_T_lidar, named))
    compare_flat(own, open_dataset("nuscenes", root, rate_hz=2, detections=str(path)))


def compare_flat(own, read):
    """Compare places on the ground: a tilted mounting turns boxes that stand upright."""
    for name in own.scene_names:
        frames = [list(key_frames(data.scene(name))) for data in (own, read)]
        for a, b in zip(*frames, strict=True):
            assert len(a.detections) == len(b.detections) > 0
            np.testing.assert_allclose(b.detections.centre_m, a.detections.centre_m, atol=1e-5)
            turned = wrap_angle(b.detections.yaw_rad - a.detections.yaw_rad)
            np.testing.assert_allclose(turned, 0.0, atol=1e-3)


def test_pickles_are_converted_by_a_list_of_what_may_be_in_them(tmp_path, monkeypatch):
    """Of MMDetection3D: tensors and its own class of boxes, whose bottom is at z."""
    import torch

    module = types.ModuleType("mmdet3d")
    boxes_class = type("LiDARInstance3DBoxes", (), {"__module__": module.__name__})
    module.LiDARInstance3DBoxes = boxes_class
    monkeypatch.setitem(sys.modules, module.__name__, module)
    boxes = boxes_class()
    boxes.tensor = torch.tensor([[1.0, 2.0, 3.0, 4.0, 2.0, 1.0, 0.5, 6.0, 7.0]])
    entry = {
        "sample_idx": "a",
        "pred_instances_3d": {
            "bboxes_3d": boxes,
            "scores_3d": torch.tensor([0.5]),
            "labels_3d": torch.tensor([1]),
        },
    }
    done, out = unpickled(tmp_path, [entry], "--classes", "car,bus")
    assert (done.returncode, done.stderr) == (0, "")
    read = read_export(out)
    assert (read.frames, read.label.tolist()) == (("a",), ["bus"])
    assert read.centre_m.tolist() == [[1.0, 2.0, 3.5]]
    assert read.velocity_mps.tolist() == [[6.0, 7.0]]


class Canary:
    """Writes a file when it is loaded by an ordinary unpickler."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return (exec, (f"open({str(self.path)!r}, 'w').close()",))


def test_a_malicious_pickle_is_refused_by_the_script_and_never_read_by_the_package(
    root_of, tmp_path
):
    canary = tmp_path / "executed"
    data = pickle.dumps([{"frame_id": Canary(canary)}])
    done, out = unpickled(tmp_path, data)
    assert done.returncode == 2
    assert "holds builtins.exec" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not out.exists()
    (tmp_path / "d.npz").write_bytes(data)
    dataset = open_dataset("folder", root_of("folder"), detections=str(tmp_path / "d.npz"))
    with pytest.raises(MottrackError, match="unreadable"):
        _ = dataset.scene(dataset.scene_names[0]).frame(0)
    assert not canary.exists()


GOOD = {"frame_id": "0", "name": ["car"], "score": [1.0], "boxes_lidar": [[0, 0, 0, 1, 1, 1, 0]]}
BAD = (
    ([GOOD | {"boxes_lidar": [[0, 0, 0, 1, 1, 1]]}], "7 or 9 finite numbers"),
    ([GOOD | {"boxes_lidar": [[0, 0, 0, -1, 1, 1, 0]]}], "sizes in"),
    ([GOOD | {"boxes_lidar": [[0, 0, 1e9, 1, 1, 1, 0]]}], "within"),
    ([GOOD | {"boxes_lidar": [[0, 0, 0, 1, 1, 1, 90]]}], "heading in radians"),
    ([GOOD | {"score": []}], "lengths of boxes_lidar, score, name"),
    ([GOOD | {"name": [3]}], "dataset.detector.classes"),
    ([GOOD | {"frame_id": None}], "frame_id"),
    ([GOOD, GOOD], "there twice"),
    ([3], "frame 0 is int"),
    ({"a": 1}, "a list of frames"),
    ({"bboxes_3d": [], "scores_3d": [], "labels_3d": [], "box_type_3d": "Camera"}, "LiDAR boxes"),
)


@pytest.mark.parametrize(("content", "message"), BAD)
def test_a_bad_export_gives_one_line(tmp_path, content, message):
    path = tmp_path / "d.json"
    path.write_text(json.dumps(content))
    with pytest.raises(MottrackError, match=message) as error:
        read_export(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)


def test_frames_that_are_missing_or_of_any_scene_are_told(root_of, tmp_path):
    """A detector that ran on every second frame is no detector that found nothing."""
    root = root_of("folder")
    own = open_dataset("folder", root)
    entries = openpcdet_entries(own, Pose.identity(), lambda s, f: f"{s}/{f.token}")
    path = write_openpcdet(tmp_path / "d.json", entries[::2])
    read = open_dataset("folder", root, detections=str(path))
    with pytest.raises(MottrackError, match="is missing, expected every frame of"):
        _ = read.scene(read.scene_names[0]).frame(0)
    root = root_of("kitti")
    own = open_dataset("kitti", root)
    entries = openpcdet_entries(own, Pose.identity(), lambda _, f: f.token)[:2]
    path = write_openpcdet(tmp_path / "k.json", entries)
    read = open_dataset("kitti", root, detections=str(path))
    with pytest.raises(MottrackError, match="the scene of each frame"):
        _ = read.scene(read.scene_names[0]).frame(0)


def test_labels_that_nobody_knows_are_told(root_of, tmp_path):
    """Else a tracker would run on nothing at all."""
    root = root_of("kitti")
    own = open_dataset("kitti", root)
    entries = openpcdet_entries(own, Pose.identity(), lambda s, f: f"{s}/{f.token}")
    for entry in entries:
        entry["name"] = np.array(["vehicle"] * len(entry["name"]))
    path = write_openpcdet(tmp_path / "d.json", entries)
    read = open_dataset("kitti", root, detections=str(path))
    with pytest.raises(MottrackError, match="label is vehicle, expected one of"):
        _ = read.scene(read.scene_names[0]).frame(0)
