"""Write ROS 2 logs with the mcap and rosbags libraries."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import Pose
from mottrack.formats.rigid import quaternion_wxyz

KINDS = {"/points": "sensor_msgs/msg/PointCloud2", "/odometry": "nav_msgs/msg/Odometry"}
RECORDING_DELAY_NS = 5_000_000


def write_log(path: Path, clouds: Mapping[int, np.ndarray], poses: Mapping[int, Pose]) -> None:
    """Write point clouds, structured arrays of float32, and poses, both by header stamp."""
    pytest.importorskip("rosbags", reason="needs the extra: pip install mottrack[ros]")
    points = {stamp: point_cloud(stamp, rows) for stamp, rows in clouds.items()}
    trajectory = {stamp: odometry(stamp, pose) for stamp, pose in poses.items()}
    write_messages(path, {"/points": points, "/odometry": trajectory})


def write_messages(path: Path, messages: Mapping[str, Mapping[int, bytes]]) -> None:
    """Write serialised messages by topic and header stamp; clouds are recorded a little later."""
    pytest.importorskip("mcap", reason="needs the extra: pip install mottrack[ros]")
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, by_stamp in messages.items():
            schema = writer.register_schema(name=KINDS[topic], encoding="ros2msg", data=b"")
            channel = writer.register_channel(topic, "cdr", schema)
            delay_ns = RECORDING_DELAY_NS if topic == "/points" else 0
            for stamp, data in by_stamp.items():
                writer.add_message(channel, stamp + delay_ns, data, stamp)
        writer.finish()


def types():
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def header(stamp_ns):
    store = types().types
    time = store["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    return store["std_msgs/msg/Header"](time, "base_link")


def odometry(stamp_ns, pose):
    store = types().types
    w, x, y, z = quaternion_wxyz(pose.rotation).tolist()
    place = store["geometry_msgs/msg/Point"](*pose.translation_m.tolist())
    posed = store["geometry_msgs/msg/PoseWithCovariance"](
        store["geometry_msgs/msg/Pose"](place, store["geometry_msgs/msg/Quaternion"](x, y, z, w)),
        np.zeros(36),
    )
    zero = store["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    twist = store["geometry_msgs/msg/TwistWithCovariance"](
        store["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36)
    )
    message = store["nav_msgs/msg/Odometry"](header(stamp_ns), "base_link", posed, twist)
    return bytes(types().serialize_cdr(message, message.__msgtype__))


def point_cloud(stamp_ns, points):
    store = types().types
    field = store["sensor_msgs/msg/PointField"]
    fields = [field(name, 4 * i, 7, 1) for i, name in enumerate(points.dtype.names)]
    step = points.dtype.itemsize
    data = np.frombuffer(points.tobytes(), np.uint8)
    message = store["sensor_msgs/msg/PointCloud2"](
        header(stamp_ns), 1, len(points), fields, False, step, step * len(points), data, False
    )
    return bytes(types().serialize_cdr(message, message.__msgtype__))


def structured(xyz_m: np.ndarray, intensity: np.ndarray) -> np.ndarray:
    """Return points (N, 3) and intensities (N,) as a cloud's rows."""
    rows = np.zeros(len(xyz_m), dtype=[(name, "<f4") for name in ("x", "y", "z", "intensity")])
    for column, axis in enumerate("xyz"):
        rows[axis] = xyz_m[:, column]
    rows["intensity"] = intensity
    return rows
