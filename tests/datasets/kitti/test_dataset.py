"""The KITTI reader, and its errors on damaged files."""

from pathlib import Path

import numpy as np
import pytest

from mottrack.core import ConfigError, DataError
from mottrack.datasets.kitti.config import KittiConfig
from mottrack.datasets.kitti.dataset import Kitti
from mottrack.lidar.in_boxes import points_in_boxes


def scene_of(root, **options):
    return Kitti(KittiConfig(root=root, **options)).scene("0000")


def test_reads_truth_detections_and_sweeps_in_one_world(kitti_root):
    scene = scene_of(kitti_root)
    assert (len(scene), scene.has_sweeps) == (3, True)
    frame = scene.frame(1)
    assert (frame.stamp_ns, frame.token) == (100_000_000, "000001")
    np.testing.assert_allclose(frame.world_T_ego.translation_m, [0.5, 0, 0], atol=1e-9)
    np.testing.assert_allclose(frame.truth.centre_m, [[21.27, -2.0, -0.93]], atol=1e-9)
    np.testing.assert_allclose(frame.truth.velocity_mps, [[10.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(frame.detections.centre_m, frame.truth.centre_m, atol=1e-6)
    assert (frame.truth.label[0], frame.detections.label[0]) == ("car", "car")
    assert scene.frame(0).detections is not None
    assert len(scene.frame(0).detections) == 0
    ego = frame.truth.transformed(frame.world_T_ego.inverse(), "ego")
    inside = points_in_boxes(scene.sweep(1).xyz_m, ego.centre_m, ego.size_m, ego.yaw_rad)
    assert inside.of(0).tolist() == [0]
    right, left = frame.labelled_azimuth_rad
    assert right == pytest.approx(-np.arctan(600 / 700))
    assert left == -right


def test_frames_without_sweep_can_be_left_out(kitti_root):
    (kitti_root / "training/velodyne/0000/000001.bin").unlink()
    assert not scene_of(kitti_root).has_sweeps
    scene = scene_of(kitti_root, require_sweeps=True)
    assert [scene.frame(i).token for i in range(len(scene))] == ["000000", "000002"]
    assert scene.has_sweeps
    assert len(scene_of(kitti_root, frames=2)) == 2


def test_oxts_and_poses_agree(kitti_root):
    # 0.5 m a frame along east at the equator, where a degree is the same length both ways
    degrees = np.degrees(0.5 / 6_378_137.0)
    rows = [f"0 {degrees * i:.15f} 0 0 0 0" + " 0" * 24 for i in range(3)]
    (kitti_root / "training/oxts").mkdir()
    (kitti_root / "training/oxts/0000.txt").write_text("\n".join(rows))
    oxts = scene_of(kitti_root, poses="oxts")
    poses = scene_of(kitti_root, poses="poses")
    for index in range(3):
        a, b = oxts.frame(index), poses.frame(index)
        np.testing.assert_allclose(a.world_T_ego.matrix, b.world_T_ego.matrix, atol=1e-6)
        np.testing.assert_allclose(a.truth.centre_m, b.truth.centre_m, atol=1e-6)


def test_without_poses_the_vehicle_stands(kitti_root):
    scene = scene_of(kitti_root, poses="none")
    assert len(scene) == 3
    np.testing.assert_allclose(scene.frame(1).truth.velocity_mps, [[5.0, 0.0]], atol=1e-9)


BROKEN = {
    "cut sweep": ("velodyne/0000/000001.bin", lambda b: b[:-3], "000001.bin: size in bytes is 29"),
    "empty sweep": ("velodyne/0000/000001.bin", lambda _: b"", "size in bytes is 0"),
    "NaN point": (
        "velodyne/0000/000001.bin",
        lambda b: b[:4] + np.float32(np.nan).tobytes() + b[8:],
        "point 0 is",
    ),
    "far point": (
        "velodyne/0000/000001.bin",
        lambda b: np.float32(1e30).tobytes() + b[4:],
        "within 2000",
    ),
    "broken label": (
        "label_02/0000.txt",
        lambda b: b.replace(b"20.5", b"2o.5"),
        "line 3, z is 2o.5",
    ),
    "short label": ("label_02/0000.txt", lambda b: b[:-30], "line 4 is 14 values"),
    "negative size": (
        "label_02/0000.txt",
        lambda b: b.replace(b"1.5 1.8 4.2 2.0 1.6 20.0", b"1.5 -1.8 4.2 2.0 1.6 20.0"),
        "line 2, w is -1.8",
    ),
    "track twice": ("label_02/0000.txt", lambda b: b.replace(b"1 7 Van", b"0 7 Van"), "track is 7"),
    "missing pose": (
        "poses/0000.txt",
        lambda b: b"\n".join(b.splitlines()[:2]),
        "number of poses is 2, expected 3",
    ),
    "bad rotation": (
        "poses/0000.txt",
        lambda b: b.replace(b"1 0 0 0 0 1", b"1 0 0 0 0 2"),
        "rotation",
    ),
    "no R_rect": ("calib/0000.txt", lambda b: b.replace(b"R_rect", b"R_left"), "R_rect is missing"),
    "no poses": ("poses/0000.txt", lambda _: b"", "lines is 0, expected one for each frame"),
    "no view": (
        "calib/0000.txt",
        lambda b: b.replace(b"P2: 700", b"P2: 0"),
        "P2 is focal length 0",
    ),
    "degrees": (
        "label_02/0000.txt",
        lambda b: b.replace(b"-1.5707963267948966", b"-90"),
        "line 2, ry is -90.0, expected radians",
    ),
    "no 64 bits": (
        "label_02/0000.txt",
        lambda b: b.replace(b"1 7 Van", b"1 99999999999999999999 Van"),
        "line 3, track is 99999999999999999999, expected an integer of 64 bits",
    ),
    "no such frame": (
        "label_02/0000.txt",
        lambda b: b.replace(b"1 7 Van", b"1000000 7 Van"),
        "line 3, frame is 1000000, expected a frame number of 0 to 999999",
    ),
    "not on Earth": (
        "poses/0000.txt",
        lambda b: b.replace(b"1 0 0 0 ", b"1 0 0 1e300 ", 1),
        r"line 1 is at \[1e\+300",
    ),
    "not text": ("calib/0000.txt", lambda b: b"\xff" + b, "UTF-8"),
}


def read_second_frame(root):
    scene = scene_of(root)
    return scene.frame(1), scene.sweep(1)


@pytest.mark.parametrize("fault", BROKEN)
def test_damaged_file_is_named(kitti_root, fault):
    name, damage, message = BROKEN[fault]
    path = kitti_root / "training" / name
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(DataError, match=message) as caught:
        read_second_frame(kitti_root)
    assert caught.value.file == path
    assert "\n" not in str(caught.value)


def test_missing_things_are_named(kitti_root, tmp_path):
    with pytest.raises(ConfigError, match="unknown scene '0001'"):
        Kitti(KittiConfig(root=kitti_root)).scene("0001")
    with pytest.raises(ConfigError, match="did you mean '0000'"):
        _ = Kitti(KittiConfig(root=kitti_root, scenes=("000",))).scene_names
    with pytest.raises(DataError, match="split is missing"):
        Kitti(KittiConfig(root=kitti_root, split="testing"))
    (tmp_path / "empty/training").mkdir(parents=True)
    with pytest.raises(DataError, match="empty folder"):
        Kitti(KittiConfig(root=tmp_path / "empty"))
    with pytest.raises(DataError, match="inside the data root"):
        scene_of(kitti_root, detections="../elsewhere").frame(0)
    (kitti_root / "training/poses/0000.txt").unlink()
    with pytest.raises(DataError, match=r"poses.0000\.txt: file is missing"):
        scene_of(kitti_root)


def test_real_sequence(shared_data):
    """Counts of the shared copy's README, over the AB3DMOT validation split."""
    validation = [1, 6, 8, 10, 12, 13, 14, 15, 16, 18, 19]
    root = Path(shared_data) / "kitti_tracking"
    dataset = Kitti(KittiConfig(root=root, class_map={"Car": "car"}, detections=None))
    boxes, ids = 0, 0
    for number in validation:
        scene = dataset.scene(f"{number:04d}")
        truths = [scene.frame(i).truth for i in range(len(scene))]
        boxes += sum(len(t) for t in truths)
        ids += len({i for t in truths for i in t.id.tolist()})
    assert (boxes, ids) == (9550, 190)
