"""The folder format and ROS 2 logs."""

import numpy as np
import pytest

from mottrack.core import ConfigError, DataError, Pose
from mottrack.datasets.folder.config import FolderConfig
from mottrack.datasets.folder.dataset import Folder
from mottrack.datasets.plausibility.watch import SceneWatch
from tests.datasets import ros_log

STAMPS = [1_000_000_000, 1_100_000_000, 1_200_000_000]
BOX = "4.0,2.0,1.5,0.1"


def cloud(number):
    return np.random.default_rng(number).uniform(-20, 20, (200, 3)).astype(np.float32)


@pytest.fixture
def log(tmp_path):
    """Three frames 1 m apart along y, the ego facing +y; one car ahead that drives as fast."""
    folder = tmp_path / "monday-01"
    (folder / "sweeps").mkdir(parents=True)
    half = np.sqrt(0.5)
    poses = ["stamp_ns,x,y,z,qw,qx,qy,qz"]
    boxes = ["stamp_ns,id,label,x,y,z,length,width,height,yaw"]
    detections = ["stamp_ns,label,score,x,y,z,length,width,height,yaw"]
    for number, stamp in enumerate(STAMPS):
        poses.append(f"{stamp},5.0,{float(number)},0.0,{half},0,0,{half}")
        boxes.append(f"{stamp},7,car,10.0,0.0,0.5,{BOX}")
        detections.append(f"{stamp},car,0.9,10.1,0.0,0.5,{BOX}")
        values = np.column_stack([cloud(number), np.full(200, 0.25)]).astype("<f4")
        if number < 2:
            values.tofile(folder / f"sweeps/{stamp}.bin")
        else:
            np.savez(
                folder / f"sweeps/{stamp}.npz",
                xyz_m=values[:, :3],
                reflectance=values[:, 3],
                ring=np.arange(200) % 16,
            )
    for name, rows in (("poses", poses), ("boxes", boxes), ("detections", detections)):
        (folder / f"{name}.csv").write_text("\n".join(rows) + "\n")
    return folder


def open_log(folder, **options):
    return Folder(FolderConfig(root=folder.parent, **options)).scene(folder.name)


def test_reads_poses_boxes_detections_and_both_kinds_of_sweep(log):
    scene = open_log(log)
    assert (len(scene), scene.has_sweeps) == (3, True)
    frame = scene.frame(1)
    # 10 m ahead of an ego that faces +y
    np.testing.assert_allclose(frame.truth.centre_m, [[5.0, 11.0, 0.5]], atol=1e-12)
    np.testing.assert_allclose(frame.truth.yaw_rad, [np.pi / 2 + 0.1], atol=1e-12)
    np.testing.assert_allclose(frame.truth.velocity_mps, [[0.0, 10.0]], atol=1e-9)
    np.testing.assert_allclose(frame.detections.centre_m, [[5.0, 11.1, 0.5]], atol=1e-12)
    for number in range(3):
        np.testing.assert_array_equal(scene.sweep(number).xyz_m, cloud(number))
    assert scene.sweep(2).ring[17] == 1


def test_key_frames_may_be_the_labelled_ones(log):
    rows = (log / "boxes.csv").read_text().splitlines()
    (log / "boxes.csv").write_text("\n".join(rows[:2]) + "\n")
    assert [open_log(log, key_frames="labelled").frame(i).is_key for i in range(3)] == [1, 0, 0]
    assert all(open_log(log).frame(i).is_key for i in range(3))


FAULTS = {
    "stamp not later": ("poses.csv", "1100000000,", "1000000000,", "later than 1000000000"),
    "no unit quaternion": (
        "poses.csv",
        "0.7071067811865476,0,0",
        "1.7,0,0",
        "pose is .* expected a unit quaternion",
    ),
    "no number": ("boxes.csv", "10.0", "ten", "line 2, x is ten"),
    "no pose": ("boxes.csv", "1200000000", "1300000000", "a stamp of poses.csv"),
    "far from the vehicle": ("boxes.csv", "10.0,0.0", "1e6,0.0", "x is 1000000.0, expected within"),
    "degrees": ("boxes.csv", ",0.1", ",90", "yaw is 90.0, expected radians"),
    "no label": ("boxes.csv", "car", "", "line 2, label is empty, expected text"),
    "identity twice": ("boxes.csv", "1200000000", "1100000000", "line 4, id is 7, expected each"),
    "not on Earth": ("poses.csv", "5.0", "1e300", r"line 2, pose is at \[1e\+300"),
    "no size": ("detections.csv", ",4.0,", ",0.0,", "length is 0.0"),
    "other header": ("detections.csv", "score", "confidence", "the header stamp_ns,label,score"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(log, fault):
    name, old, new, message = FAULTS[fault]
    path = log / name
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(DataError, match=message) as caught:
        open_log(log).frame(0)
    assert caught.value.file == path


def test_a_byte_order_mark_is_no_fault(log):
    path = log / "poses.csv"
    path.write_text("\ufeff" + path.read_text().replace("\n", "\r\n"))
    assert len(open_log(log)) == 3


def test_a_choice_of_scenes_is_not_empty_and_has_each_once(log):
    for scenes in ((), (log.name, log.name)):
        with pytest.raises(
            ConfigError, match=r"dataset\.scenes is \[.*\], expected names, each once"
        ):
            open_log(log, scenes=scenes)


def test_damaged_sweeps_are_named(log):
    path = log / f"sweeps/{STAMPS[2]}.npz"
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(DataError, match="unreadable"):
        open_log(log).sweep(2)
    np.savez(path, xyz_m=np.zeros((4, 2)), reflectance=np.zeros(4))
    with pytest.raises(DataError, match="shapes"):
        open_log(log).sweep(2)
    (log / "poses.csv").unlink()
    with pytest.raises(DataError, match="scenes is none"):
        _ = Folder(FolderConfig(root=log.parent)).scene_names
    (log / "poses.csv").write_text("")
    with pytest.raises(ConfigError, match="unknown scene"):
        Folder(FolderConfig(root=log.parent)).scene("tuesday")


@pytest.fixture
def bag(tmp_path):
    """Three clouds at 10 Hz and odometry at 50 Hz, the clouds between two odometry messages."""
    path = tmp_path / "drive.mcap"
    poses = {
        STAMPS[0] + 20_000_000 * number: Pose.from_yaw(0.0, (0.2 * number, 0.0, 0.0))
        for number in range(-5, 20)
    }
    clouds = {}
    for number, stamp in enumerate(STAMPS):
        no_return = np.array([[np.nan, 0.0, 0.0]])
        xyz_m = np.concatenate([cloud(number), no_return])
        clouds[stamp + 10_000_000] = ros_log.structured(xyz_m, np.full(201, 51.0))
    ros_log.write_log(path, clouds, poses)
    return path


def open_bag(path, **options):
    from mottrack.datasets.ros.config import RosConfig
    from mottrack.datasets.ros.dataset import RosLogs

    return RosLogs(RosConfig(root=path.parent, **options)).scene(path.stem)


def test_ros_log(bag):
    scene = open_bag(bag, lidar_position_m=(1.0, 0.0, 2.0), lidar_yaw_rad=np.pi / 2)
    assert len(scene) == 3
    mounting = Pose.from_yaw(np.pi / 2, (1.0, 0.0, 2.0))
    for number in range(3):
        frame, sweep = scene.frame(number), scene.sweep(number)
        assert frame.stamp_ns == STAMPS[number] + 10_000_000
        # half way between two odometry messages at 10 m/s
        np.testing.assert_allclose(frame.world_T_ego.translation_m, [number + 0.1, 0, 0], atol=1e-9)
        np.testing.assert_allclose(sweep.xyz_m, mounting.apply(cloud(number)), atol=1e-5)
        np.testing.assert_allclose(sweep.reflectance, 0.2, atol=1e-6)


def test_ros_faults_are_named(bag):
    with pytest.raises(DataError, match="no message on /lidar, expected one of /odometry, /points"):
        open_bag(bag, points_topic="/lidar")
    with pytest.raises(DataError, match="odometry is missing"):
        open_bag(bag, max_gap_s=0.01)
    with pytest.raises(DataError, match="no message on /odom, expected one of"):
        open_bag(bag, odometry_topic="/odom")
    data = bag.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(100):
        bag.write_bytes(data[: int(rng.integers(len(data)))])
        with pytest.raises(DataError) as caught:
            open_bag(bag).sweep(0)
        assert caught.value.file == bag
    reported = 0
    for _ in range(100):
        damaged = bytearray(data)
        damaged[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        bag.write_bytes(damaged)
        try:
            open_bag(bag).sweep(0)
        except DataError as error:
            reported += error.file == bag
    assert reported > 50  # chunks carry a checksum; the rest is in indices and names


def test_a_message_that_was_recorded_cut_is_named(bag):
    """The file is whole, its content is not: a recorder that was out of memory."""
    cut = ros_log.point_cloud(STAMPS[0], ros_log.structured(cloud(0), np.zeros(200)))[:200]
    pose = ros_log.odometry(STAMPS[0], Pose.identity())
    ros_log.write_messages(bag, {"/points": {STAMPS[0]: cut}, "/odometry": {STAMPS[0]: pose}})
    with pytest.raises(DataError, match=r"drive\.mcap: content is unreadable \(SerdeError"):
        open_bag(bag).sweep(0)


def padded_cloud(stamp_ns: int, row_step: int, pad: int) -> bytes:
    """A cloud of two rows of a hundred points, each row followed by `pad` bytes."""
    store = ros_log.types().types
    points = ros_log.structured(cloud(0), np.full(200, 51.0)).reshape(2, 100)
    step = points.dtype.itemsize
    data = b"".join(row.tobytes() + b"\xff" * pad for row in points)
    field = store["sensor_msgs/msg/PointField"]
    fields = [field(name, 4 * i, 7, 1) for i, name in enumerate(points.dtype.names)]
    message = store["sensor_msgs/msg/PointCloud2"](
        ros_log.header(stamp_ns),
        2,
        100,
        fields,
        False,
        step,
        row_step,
        np.frombuffer(data, np.uint8),
        False,
    )
    return bytes(ros_log.types().serialize_cdr(message, message.__msgtype__))


@pytest.mark.parametrize(("row_step", "pad"), [(1600, 0), (0, 0), (1664, 64)])
def test_rows_of_a_cloud_may_be_padded(bag, row_step, pad):
    """Rows are at k x row_step; 0 means that they are not padded."""
    data = padded_cloud(STAMPS[0], row_step, pad)
    poses = {stamp: ros_log.odometry(stamp, Pose.identity()) for stamp in STAMPS}
    ros_log.write_messages(bag, {"/points": {STAMPS[0]: data}, "/odometry": poses})
    np.testing.assert_allclose(open_bag(bag).sweep(0).xyz_m, cloud(0), atol=1e-5)


def test_a_row_step_that_is_too_small_and_topics_in_each_others_place(bag):
    poses = {stamp: ros_log.odometry(stamp, Pose.identity()) for stamp in STAMPS}
    data = padded_cloud(STAMPS[0], 100, 0)
    ros_log.write_messages(bag, {"/points": {STAMPS[0]: data}, "/odometry": poses})
    with pytest.raises(DataError, match="row_step is 100, expected at least 1600"):
        open_bag(bag).sweep(0)
    with pytest.raises(
        DataError, match="type of /points is sensor_msgs/msg/PointCloud2, expected nav"
    ):
        open_bag(bag, points_topic="/odometry", odometry_topic="/points")


def test_a_log_of_a_killed_recorder(bag):
    bag.write_bytes(bag.read_bytes()[:-20])
    with pytest.raises(DataError, match="unfinished, expected a finished log"):
        open_bag(bag)


def concerns_of(scene):
    watch = SceneWatch(scene)
    for index in range(len(scene)):
        watch.add_unseen(scene.frame(index), scene.sweep(index))
    return [str(concern) for concern in watch.concerns()]


@pytest.mark.parametrize("how", ["missing", "no bytes", "no points"])
@pytest.mark.parametrize("which", [0, 2])
def test_a_lost_sweep_costs_that_sweep(log, how, which):
    path = next(log.glob(f"sweeps/{STAMPS[which]}.*"))
    path.unlink()
    if how == "no bytes":
        path.write_bytes(b"")
    elif how == "no points":
        nothing = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        np.savez(path.with_suffix(".npz"), xyz_m=nothing[0], reflectance=nothing[1])
    scene = open_log(log)
    assert [len(scene.sweep(i)) for i in range(3)] == [200 * (i != which) for i in range(3)]
    assert concerns_of(scene) == [
        f"sweeps that are missing or empty: 1, first at frame {STAMPS[which]}"
    ]


def test_a_cloud_without_points_costs_that_sweep(bag):
    clouds = {stamp: ros_log.structured(cloud(0), np.zeros(200)) for stamp in STAMPS}
    clouds[STAMPS[1]] = clouds[STAMPS[1]][:0]
    ros_log.write_log(bag, clouds, {stamp: Pose.identity() for stamp in STAMPS})
    scene = open_bag(bag)
    assert [len(scene.sweep(i)) for i in range(3)] == [200, 0, 200]
    assert concerns_of(scene) == [
        f"sweeps that are missing or empty: 1, first at frame {STAMPS[1]}"
    ]


def test_a_log_without_any_sweep_names_the_first(log):
    for path in log.glob("sweeps/*"):
        path.unlink()
    assert not open_log(log).has_sweeps
    with pytest.raises(DataError, match=f"{STAMPS[0]}.bin: file is missing"):
        open_log(log).sweep(0)
