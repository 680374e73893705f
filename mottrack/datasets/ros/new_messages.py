"""Messages of ROS 2 made of arrays and poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import Pose
from mottrack.core.arrays import F32, F64
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.ros.message_types import type_store
from mottrack.formats.rigid import quaternion_wxyz

_FIELD_TYPES = {"f4": 7, "f8": 8, "u2": 4, "u1": 2, "i4": 5, "u4": 6}
"""numpy's letter of a type to sensor_msgs/msg/PointField's number."""


def new(kind: str, *values: Any) -> Any:
    """Return a message of a type, `package/Name`, with the values of its fields in order."""
    package, _, name = kind.partition("/")
    return type_store().types[f"{package}/msg/{name}"](*values)


def header(stamp_ns: int, frame_id: str) -> Any:
    """Return a std_msgs/Header."""
    seconds, nanoseconds = divmod(int(stamp_ns), SECOND_NS)
    return new("std_msgs/Header", new("builtin_interfaces/Time", seconds, nanoseconds), frame_id)


def vector(xyz: F64 | Sequence[float]) -> Any:
    """Return a geometry_msgs/Vector3 of (3,)."""
    return new("geometry_msgs/Vector3", *(float(value) for value in xyz))


def point(xyz_m: F64) -> Any:
    """Return a geometry_msgs/Point of (3,) metres."""
    return new("geometry_msgs/Point", *(float(value) for value in xyz_m))


def quaternion(wxyz: F64) -> Any:
    """Return a geometry_msgs/Quaternion, which has its w last."""
    w, x, y, z = (float(value) for value in wxyz)
    return new("geometry_msgs/Quaternion", x, y, z, w)


def pose_of(pose: Pose) -> Any:
    """Return a geometry_msgs/Pose."""
    turned = quaternion(quaternion_wxyz(pose.rotation))
    return new("geometry_msgs/Pose", point(pose.translation_m), turned)


def yaw_pose(centre_m: F64, yaw_rad: float) -> Any:
    """Return a geometry_msgs/Pose of a box that stands upright."""
    half = 0.5 * float(yaw_rad)
    turned = new("geometry_msgs/Quaternion", 0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
    return new("geometry_msgs/Pose", point(centre_m), turned)


def transform(stamp_ns: int, parent: str, child: str, parent_T_child: Pose) -> Any:
    """Return a tf2_msgs/TFMessage with one transform."""
    turned = quaternion(quaternion_wxyz(parent_T_child.rotation))
    moved = new("geometry_msgs/Transform", vector(parent_T_child.translation_m), turned)
    stamped = new("geometry_msgs/TransformStamped", header(stamp_ns, parent), child, moved)
    return new("tf2_msgs/TFMessage", [stamped])


def odometry(stamp_ns: int, parent: str, child: str, parent_T_child: Pose) -> Any:
    """Return a nav_msgs/Odometry with a pose and, unknown, a twist of zero."""
    posed = new("geometry_msgs/PoseWithCovariance", pose_of(parent_T_child), np.zeros(36))
    zero = np.zeros(3)
    twist = new("geometry_msgs/Twist", vector(zero), vector(zero))
    moved = new("geometry_msgs/TwistWithCovariance", twist, np.zeros(36))
    return new("nav_msgs/Odometry", header(stamp_ns, parent), child, posed, moved)


def point_cloud(stamp_ns: int, frame_id: str, columns: dict[str, NDArray[Any]]) -> Any:
    """Return a sensor_msgs/PointCloud2 of columns (N,) by name, packed without gaps."""
    kinds = [(name, values.dtype.newbyteorder("<")) for name, values in columns.items()]
    rows = np.empty(len(next(iter(columns.values()))), dtype=kinds)
    for name, values in columns.items():
        rows[name] = values
    fields = [
        new("sensor_msgs/PointField", name, int(offset), _FIELD_TYPES[kind.str[1:]], 1)
        for name, (kind, offset) in ((n, rows.dtype.fields[n][:2]) for n in columns)  # type: ignore[index]
    ]
    step, count = rows.dtype.itemsize, len(rows)
    data = np.frombuffer(rows.tobytes(), np.uint8)
    placed = header(stamp_ns, frame_id)
    return new(
        "sensor_msgs/PointCloud2", placed, 1, count, fields, False, step, step * count, data, True
    )


def xyz_columns(xyz_m: F32) -> dict[str, NDArray[Any]]:
    """Return points (N, 3) as the columns x, y, z."""
    return {axis: xyz_m[:, i].astype(np.float32) for i, axis in enumerate("xyz")}


def detection(stamped: Any, label: str, score: float, box: Any, name: str) -> Any:
    """Return a vision_msgs/Detection3D of one hypothesis.

    Args:
        stamped: its std_msgs/Header.
        label: class of the object.
        score: the detector's.
        box: vision_msgs/BoundingBox3D.
        name: identity of a tracked object; empty for a detection.
    """
    posed = new("geometry_msgs/PoseWithCovariance", box.center, np.zeros(36))
    hypothesis = new("vision_msgs/ObjectHypothesis", str(label), float(score))
    result = new("vision_msgs/ObjectHypothesisWithPose", hypothesis, posed)
    return new("vision_msgs/Detection3D", stamped, [result], box, name)


def box_of(centre_m: F64, size_m: F64, yaw_rad: float) -> Any:
    """Return a vision_msgs/BoundingBox3D; size (3,) is length, width, height."""
    return new("vision_msgs/BoundingBox3D", yaw_pose(centre_m, yaw_rad), vector(size_m))
