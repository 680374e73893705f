"""Logs of ROS 2 and ROS 1 as recorders write them, against what was driven."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs the extra: pip install mottrack[ros]")

from rosbags.typesys import TypesysError

from mottrack.core import DataError, InputError, Pose, Scene
from mottrack.datasets.check import check_dataset
from mottrack.datasets.ros import new_messages as ros
from mottrack.datasets.ros.config import RosConfig
from mottrack.datasets.ros.dataset import RosLogs
from mottrack.datasets.ros.message_types import store_of
from mottrack.experiment.plugins import load_part
from tests.datasets.ros import bags
from tests.datasets.ros.bags import Message, write_bag, write_ros1


def opened(root: Path, **settings: object) -> Scene:
    logs = RosLogs(RosConfig(root=root, **settings))
    return logs.scene(logs.scene_names[0])


def bare(storage: str) -> Callable[[Path], None]:
    """Only the file of a bag folder, without its metadata."""

    def write(root: Path) -> None:
        write_bag(root / "folder", bags.drive(), storage)
        file = next(p for p in (root / "folder").iterdir() if p.suffix != ".yaml")
        file.rename(root / f"drive{file.suffix}")
        shutil.rmtree(root / "folder")

    return write


BAGS: dict[str, Callable[[Path], None]] = {
    "folder, mcap": lambda root: write_bag(root / "drive", bags.drive()),
    "folder, sqlite": lambda root: write_bag(root / "drive", bags.drive(), "sqlite"),
    "file compressed": lambda root: write_bag(root / "drive", bags.drive(), "sqlite", "file"),
    "message compressed": lambda root: write_bag(root / "drive", bags.drive(), "sqlite", "message"),
    "mcap alone": bare("mcap"),
    "sqlite alone": bare("sqlite"),
    "ROS 1": lambda root: write_ros1(root / "drive.bag", bags.drive()),
}


@pytest.mark.parametrize("kind", BAGS)
def test_every_kind_of_bag_is_the_drive(kind, tmp_path):
    """Poses by tf over two moving frames, points by tf's mounting, topics that end apart."""
    BAGS[kind](tmp_path)
    if kind == "ROS 1":
        shutil.rmtree(tmp_path / "drive")
    scene = opened(tmp_path, detections_topic="/detections", class_map={"person": "pedestrian"})
    assert scene.name == "drive"
    # tf lasts from 0 s to 0.8 s: of thirteen clouds nine
    assert [scene.frame(i).stamp_ns for i in range(len(scene))] == bags.stamps(0.0, 0.8, 10)
    assert [scene.frame(i).is_key for i in range(9)] == [False] * 3 + [True] * 6
    assert scene.classes == ("car", "pedestrian")
    for index in range(9):
        frame, sweep = scene.frame(index), scene.sweep(index)
        truth = bags.world_T_ego(frame.stamp_ns)
        np.testing.assert_allclose(frame.world_T_ego.matrix, truth.matrix, atol=1e-9)
        expected = bags.MOUNT.apply(bags.cloud_points(index + 2))
        np.testing.assert_allclose(sweep.xyz_m, expected, atol=1e-5)
        np.testing.assert_allclose(sweep.origin_m, bags.MOUNT.translation_m, atol=1e-9)
    found = scene.frame(4).detections
    np.testing.assert_allclose(found.centre_m[0], bags.CAR_M, atol=1e-9)
    np.testing.assert_allclose(found.yaw_rad[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.size_m[0], bags.SIZE_M)
    assert found.label.tolist() == ["car", "pedestrian"]
    assert found.score.tolist() == [0.9, 0.5]
    assert [str(c).split(",")[0] for c in scene.concerns] == [
        "clouds at the ends of the log left out: 4",
    ]


def test_a_bag_folder_is_a_root_too_and_a_lost_part_is_named(tmp_path):
    write_bag(tmp_path / "drive", bags.drive())
    assert opened(tmp_path / "drive").name == "drive"
    (tmp_path / "drive" / "drive.mcap").unlink()
    with pytest.raises(
        DataError, match=r"drive\.mcap: file is missing, expected a part of the rec"
    ):
        opened(tmp_path / "drive")
    (tmp_path / "drive" / "metadata.yaml").write_text("rosbag2_bagfile_information: 3\n")
    with pytest.raises(DataError, match=r"metadata\.yaml: rosbag2_bagfile_information is missing"):
        opened(tmp_path / "drive")


def test_several_lidars_are_merged_in_the_vehicle(tmp_path):
    """The second is 20 ms later, has another mounting, misses one cloud and ends earlier."""
    rear = Pose.from_yaw(np.pi, (-1.0, 0.0, 1.0))
    times = bags.stamps(0.0, 0.8, 10)
    later = [stamp + 20_000_000 for stamp in times[:7]]
    messages = [
        *bags.tf(-0.1, 1.0),
        Message("/tf_static", times[0], ros.transform(times[0], "base_link", "rear", rear)),
        *bags.clouds(times),
        *[m for i, m in enumerate(bags.clouds(later, "/rear", "rear")) if i != 3],
    ]
    write_bag(tmp_path / "drive", messages)
    with pytest.raises(
        DataError, match=r"one of several: /points, /rear, expected dataset.points_t"
    ):
        opened(tmp_path)
    scene = opened(tmp_path, points_topic=("/points", "/rear"))
    assert len(scene) == 7
    assert len(scene.sweep(3)) == 300
    sweep = scene.sweep(2)
    moved = bags.world_T_ego(times[2]).inverse() @ bags.world_T_ego(later[2])
    np.testing.assert_allclose(sweep.xyz_m[:300], bags.MOUNT.apply(bags.cloud_points(2)), atol=1e-5)
    second = moved.apply(rear.apply(bags.cloud_points(2)))
    np.testing.assert_allclose(sweep.xyz_m[300:], second, atol=1e-5)
    kinds = {concern.kind: concern.count for concern in scene.concerns}
    assert kinds == {
        "clouds at the ends of the log left out": 2,
        "clouds missing between others": 1,
    }


TIMES = {
    "timestamp": lambda ns: (ns / 1e9).astype("f8"),  # Hesai
    "time": lambda ns: ((ns - bags.START_NS) / 1e9).astype("f4"),  # Velodyne
    "t": lambda ns: (ns - bags.START_NS).astype("u4"),  # Ouster
}


@pytest.mark.parametrize("name", TIMES)
def test_points_are_moved_to_the_stamp_by_their_own_time(name, tmp_path):
    """A standing wall, seen over 0.1 s from a vehicle that drives 10 m/s."""
    offset_ns = np.linspace(0, 90_000_000, 200).astype(np.int64)
    wall_m = np.column_stack([np.full(200, 30.0), np.linspace(-5, 5, 200), np.ones(200)])
    measured = np.array(
        [
            bags.world_T_ego(bags.START_NS + int(t)).inverse().apply(p[None])[0]
            for t, p in zip(offset_ns, wall_m, strict=True)
        ]
    )
    columns = ros.xyz_columns(measured.astype(np.float32))
    columns[name] = TIMES[name](bags.START_NS + offset_ns)
    cloud = ros.point_cloud(bags.START_NS, "base_link", columns)
    write_bag(tmp_path / "drive", [*bags.tf(0.0, 0.2), Message("/points", bags.START_NS, cloud)])
    sweep = opened(tmp_path, motion_compensation=True).sweep(0)
    expected = bags.world_T_ego(bags.START_NS).inverse().apply(wall_m)
    np.testing.assert_allclose(sweep.xyz_m, expected, atol=1e-4)
    np.testing.assert_allclose(sweep.time_offset_ns, offset_ns, atol=300)
    assert np.abs(opened(tmp_path).sweep(0).xyz_m - expected).max() > 0.5


def test_compensation_without_times_is_refused(tmp_path):
    write_bag(tmp_path / "drive", bags.drive())
    with pytest.raises(DataError, match="time of each point is unknown, expected one of timestamp"):
        opened(tmp_path, motion_compensation=True).sweep(0)


AUTOWARE = "autoware_perception_msgs"
_RULER = "=" * 80 + "\n"
DETECTED_OBJECTS = _RULER.join(
    [
        "std_msgs/Header header\nautoware_perception_msgs/DetectedObject[] objects\n",
        f"MSG: {AUTOWARE}/DetectedObject\nfloat32 existence_probability\n"
        "ObjectClassification[] classification\nDetectedObjectKinematics kinematics\nShape shape\n",
        # other numbers than Autoware's of today: those of the log count
        f"MSG: {AUTOWARE}/ObjectClassification\nuint8 UNKNOWN = 0\nuint8 PEDESTRIAN = 1\n"
        "uint8 CAR = 7\nuint8 label\nfloat32 probability\n",
        f"MSG: {AUTOWARE}/DetectedObjectKinematics\n"
        "geometry_msgs/PoseWithCovariance pose_with_covariance\nbool has_position_covariance\n"
        "uint8 orientation_availability\ngeometry_msgs/TwistWithCovariance twist_with_covariance\n"
        "bool has_twist\nbool has_twist_covariance\n",
        f"MSG: {AUTOWARE}/Shape\nuint8 type\ngeometry_msgs/Polygon footprint\n"
        "geometry_msgs/Vector3 dimensions\n",
    ]
)


def autoware_objects(stamp_ns: int) -> Message:
    """A car in the map that drives 8 m/s along its own axis, and a footprint without velocity."""
    kind = f"{AUTOWARE}/msg/DetectedObjects"
    store = store_of(kind, DETECTED_OBJECTS)
    types = store.types

    def one(number, yaw_rad, speed_mps, shape):
        zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        pose = ros.yaw_pose(bags.CAR_M, yaw_rad)
        along = types["geometry_msgs/msg/Vector3"](speed_mps, 0.0, 0.0)
        twist = types["geometry_msgs/msg/Twist"](along, zero)
        kinematics = types[f"{AUTOWARE}/msg/DetectedObjectKinematics"](
            types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            False,
            2,
            types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
            speed_mps != 0.0,
            False,
        )
        classes = [types[f"{AUTOWARE}/msg/ObjectClassification"](number, 0.5)]
        return types[f"{AUTOWARE}/msg/DetectedObject"](0.8, classes, kinematics, shape)

    point = types["geometry_msgs/msg/Point32"]
    corners = [point(x, y, 0.0) for x, y in ((1.5, 0.5), (-1.5, 0.5), (-1.5, -0.5), (1.5, -0.5))]
    polygon, shape = types["geometry_msgs/msg/Polygon"], types[f"{AUTOWARE}/msg/Shape"]
    objects = [
        one(7, np.pi / 2, 8.0, shape(0, polygon([]), ros.vector(bags.SIZE_M))),
        one(1, 0.0, 0.0, shape(2, polygon(corners), ros.vector([0.0, 0.0, 1.7]))),
    ]
    message = types[kind](ros.header(stamp_ns, "map"), objects)
    return Message("/objects", stamp_ns, message, kind, store)


def test_objects_of_autoware_by_the_definition_in_the_log(tmp_path):
    times = bags.stamps(0.0, 0.8, 10)
    messages = [*bags.tf(0.0, 0.8), *bags.clouds(times), *map(autoware_objects, times)]
    write_bag(tmp_path / "drive", messages)
    scene = opened(tmp_path, detections_topic="/objects", detector_velocity=True)
    found = scene.frame(2).detections
    assert found.label.tolist() == ["car", "pedestrian"]
    np.testing.assert_allclose(found.centre_m, [bags.CAR_M] * 2, atol=1e-9)
    np.testing.assert_allclose(found.size_m, [bags.SIZE_M, [3.0, 1.0, 1.7]], atol=1e-6)
    np.testing.assert_allclose(found.score, 0.4, atol=1e-6)
    # along its own axis, which points to +y of the map
    np.testing.assert_allclose(found.velocity.mean_mps[0], [0.0, 8.0], atol=1e-6)
    assert found.velocity.valid.tolist() == [True, False]


def test_a_log_of_detections_alone_is_tracked(tmp_path):
    write_bag(tmp_path / "drive", [*bags.tf(0.0, 0.8), *bags.detections(bags.stamps(0, 0.8, 10))])
    scene = opened(tmp_path, detections_topic="/detections")
    assert (len(scene), scene.has_sweeps) == (9, False)
    assert len(scene.frame(0).detections) == 2
    with pytest.raises(InputError, match="a log with point clouds"):
        scene.sweep(0)


def test_of_a_fast_detector_the_message_nearest_to_each_cloud_counts(tmp_path):
    """At 30 Hz, ending after the last pose: three messages a cloud, two of them left out."""
    times = [stamp + 3_000_000 for stamp in bags.stamps(0.0, 0.8, 30)]
    messages = [*bags.tf(0.0, 0.8), *bags.clouds(bags.stamps(0.0, 0.8, 10))]
    write_bag(tmp_path / "drive", [*messages, *bags.detections(times)])
    scene = opened(tmp_path, detections_topic="/detections")
    for index in range(9):
        found = scene.frame(index).detections
        assert len(found) == 2
        # each placed by the pose of its own time; the last is later than every pose
        atol = 0.05 if index == 8 else 1e-6
        np.testing.assert_allclose(found.centre_m[0], bags.CAR_M, atol=atol)
    kinds = {concern.kind: concern.count for concern in scene.concerns}
    assert kinds == {"messages of detections left out": 16}


def box_elsewhere() -> list[Message]:
    stamp = bags.stamps(0.3, 0.3, 1)[0]
    stamped = ros.header(stamp, "camera")
    box = ros.detection(stamped, "car", 1.0, ros.box_of(bags.CAR_M, bags.SIZE_M, 0.0), "")
    return [Message("/boxes", stamp, ros.new("vision_msgs/Detection3DArray", stamped, [box]))]


def broken_box() -> list[Message]:
    stamp = bags.stamps(0.3, 0.3, 1)[0]
    stamped = ros.header(stamp, "map")
    box = ros.detection(
        stamped, "car", 1.0, ros.box_of(bags.CAR_M, np.array([4.0, -2, 1]), 0.0), ""
    )
    return [Message("/boxes", stamp, ros.new("vision_msgs/Detection3DArray", stamped, [box]))]


FAULTS = {
    "unplaced frame": (
        box_elsewhere,
        {"detections_topic": "/boxes"},
        "frame_id of boxes is 'camera', expected map, base_link or a frame that tf places",
    ),
    "negative size": (
        broken_box,
        {"detections_topic": "/boxes"},
        r"size of a box at 1600000000300000000 is \[4.0, -2.0, 1.0\], expected in",
    ),
    "no such vehicle": (list, {"ego_frame": "body"}, "tf is no transform above body"),
    "no such topic": (
        list,
        {"detections_topic": "/objects"},
        "no message on /objects, expected one of /detections, /points, /tf, /tf_static",
    ),
    "a mounting for the vehicle": (
        list,
        {"world_frame": "base_link", "ego_frame": "lidar"},
        "tf from lidar to base_link is published once, expected dataset.world_frame and",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(fault, tmp_path):
    further, settings, words = FAULTS[fault]
    write_bag(tmp_path / "drive", [*bags.drive(), *further()])
    with pytest.raises(DataError, match=words) as caught:
        opened(tmp_path, **settings).frame(3)
    assert "\n" not in str(caught.value)


def test_clouds_and_poses_that_never_meet(tmp_path):
    write_bag(tmp_path / "drive", [*bags.tf(5.0, 6.0), *bags.clouds(bags.stamps(0.0, 1.0, 10))])
    with pytest.raises(
        DataError, match=r"frames is none, expected clouds \(1600000000.000 to 16000"
    ):
        opened(tmp_path)


HOSTILE = "a/msg/B:\n    pass\nraise SystemExit\nclass C"


@pytest.mark.parametrize("kind", [HOSTILE, "a/msg/B;raise SystemExit", "a/B/C/msg/D", "../msg/B"])
def test_no_code_in_the_name_of_a_type_is_run(kind):
    """rosbags writes Python code with the names of types, and a log chooses them."""
    with pytest.raises((ValueError, TypesysError)):
        store_of(kind, "uint8 x\n")


def test_the_recorded_log_is_read_without_settings(shared_data):
    """tf_static, odometry and the only point cloud; the same drive in Argoverse's layout."""
    scene = opened(shared_data / "ros2")
    root = shared_data / "argoverse2_driving"
    other = load_part("dataset", {"kind": "argoverse2", "root": str(root), "vehicle": None}).make()
    reference = other.scene("pandaset-002b")
    assert (len(scene), scene.concerns) == (8, ())
    for index in range(len(scene)):
        np.testing.assert_allclose(
            scene.frame(index).world_T_ego.matrix,
            reference.frame(index).world_T_ego.matrix,
            atol=1e-12,
        )
        np.testing.assert_allclose(
            scene.sweep(index).xyz_m, reference.sweep(index).xyz_m, atol=1e-6
        )
    tf = opened(shared_data / "ros2", poses="tf")
    assert all(
        np.allclose(tf.frame(i).world_T_ego.matrix, scene.frame(i).world_T_ego.matrix, atol=1e-9)
        for i in range(8)
    )


def test_a_check_says_what_was_left_out(tmp_path):
    write_bag(tmp_path / "drive", bags.drive())
    lines = list(check_dataset(RosLogs(RosConfig(root=tmp_path))).lines())
    assert any("clouds at the ends of the log left out: 4" in line for line in lines)
