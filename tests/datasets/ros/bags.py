"""A short drive as messages of ROS 2, written by rosbags as every kind of bag."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core import Pose
from mottrack.datasets.ros import new_messages as ros
from mottrack.datasets.ros.message_types import type_store

START_NS = 1_600_000_000_000_000_000
SPEED_MPS = 10.0
MOUNT = Pose.from_yaw(-np.pi / 2, (1.0, 0.0, 2.0))
"""`base_link_T_lidar`."""
CAR_M = np.array([20.0, 3.0, 0.5])
"""Where a car stands in the map."""
SIZE_M = np.array([4.0, 2.0, 1.5])


class Message(NamedTuple):
    topic: str
    stamp_ns: int
    message: Any
    kind: str = ""
    """Type of a message that is not of rosbags' own store."""
    store: Any = None


def world_T_ego(stamp_ns: int) -> Pose:
    """Straight along x, turned by 30 degrees in the odometry, which drifts 5 m to the side."""
    seconds = (stamp_ns - START_NS) / 1e9
    return Pose.from_yaw(np.pi / 6, (SPEED_MPS * seconds, 5.0, 0.0))


MAP_T_ODOM = Pose.from_yaw(np.pi / 6, (100.0, 0.0, 0.0))


def stamps(first_s: float, last_s: float, hz: float) -> list[int]:
    count = round((last_s - first_s) * hz) + 1
    return [START_NS + round((first_s + i / hz) * 1e9) for i in range(count)]


def cloud_points(number: int) -> np.ndarray:
    return np.random.default_rng(number).uniform(-20, 20, (300, 3)).astype(np.float32)


def tf(first_s: float, last_s: float) -> list[Message]:
    """map -> odom once a second, odom -> base_link at 50 Hz, the LiDAR's mounting once."""
    found = [
        Message("/tf_static", START_NS, ros.transform(START_NS, "base_link", "lidar", MOUNT)),
    ]
    found += [
        Message("/tf", stamp, ros.transform(stamp, "map", "odom", MAP_T_ODOM))
        for stamp in stamps(first_s - 1.0, last_s + 1.0, 1)
    ]
    for stamp in stamps(first_s, last_s, 50):
        pose = MAP_T_ODOM.inverse() @ world_T_ego(stamp)
        found.append(Message("/tf", stamp, ros.transform(stamp, "odom", "base_link", pose)))
    return found


def clouds(times: Iterable[int], topic: str = "/points", frame: str = "lidar") -> list[Message]:
    return [
        Message(topic, stamp, ros.point_cloud(stamp, frame, ros.xyz_columns(cloud_points(number))))
        for number, stamp in enumerate(times)
    ]


def detections(times: Iterable[int]) -> list[Message]:
    """A standing car and a pedestrian 5 m ahead, in the vehicle's frame, as of vision_msgs."""
    found = []
    for stamp in times:
        stamped, ego_T_world = ros.header(stamp, "base_link"), world_T_ego(stamp).inverse()
        centre_m = ego_T_world.apply(CAR_M[None])[0]
        boxes = [
            ros.detection(
                stamped, "CAR", 0.9, ros.box_of(centre_m, SIZE_M, ego_T_world.yaw_rad), ""
            ),
            ros.detection(
                stamped, "person", 0.5, ros.box_of(np.array([5.0, 0, 0]), np.ones(3), 0.0), ""
            ),
        ]
        found.append(
            Message("/detections", stamp, ros.new("vision_msgs/Detection3DArray", stamped, boxes))
        )
    return found


def drive() -> list[Message]:
    """Clouds from -0.2 s to 1 s, tf from 0 s to 0.8 s, detections from 0.3 s on."""
    times = stamps(-0.2, 1.0, 10)
    return [*tf(0.0, 0.8), *clouds(times), *detections(times[5:])]


def write_bag(
    path: Path, messages: Iterable[Message], storage: str = "mcap", pack: str = ""
) -> None:
    """Write a bag folder of ROS 2."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer(path, version=9, storage_plugin=plugin)
    if pack:
        writer.set_compression(CompressionMode[pack.upper()], CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for one in sorted(messages, key=lambda one: one.stamp_ns):
            kind, store = one.kind or one.message.__msgtype__, one.store or type_store()
            if one.topic not in connections:
                connections[one.topic] = writer.add_connection(one.topic, kind, typestore=store)
            data = store.serialize_cdr(one.message, kind)
            writer.write(connections[one.topic], one.stamp_ns, data)


def write_ros1(path: Path, messages: Iterable[Message]) -> None:
    """Write a ROS 1 bag, by way of rosbags' own conversion."""
    from rosbags.convert.converter import convert
    from rosbags.typesys import Stores, get_typestore

    between = path.with_suffix("")
    write_bag(between, messages)
    target = get_typestore(Stores.ROS1_NOETIC)
    target.register(
        {name: value for name, value in type_store().fielddefs.items() if name.startswith("vision")}
    )
    convert([between], path, "", 9, None, "", None, target, (), (), (), ())
