"""Messages of ROS to arrays and poses, whatever file they come from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import Pose
from mottrack.core.arrays import F64
from mottrack.core.errors import DataError, InputError
from mottrack.core.sweep import SECOND_NS
from mottrack.formats.checks import check_count
from mottrack.formats.faults import MissingError
from mottrack.formats.rigid import quaternion_pose

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/msg/PointField's numbers of types."""


def point_columns(message: Any, path: Path) -> dict[str, NDArray[Any]]:
    """Return each field of a PointCloud2 as an array (N,), without the points that are NaN.

    Drivers mark a beam without return by NaN coordinates, so those are no fault here.

    Raises:
        DataError: the size of the data does not fit its description, or x, y, z are missing.
    """
    dtype = _layout(message, path)
    width, height = int(message.width), int(message.height)
    count = width * height
    check_count(path, count)
    row_bytes = _row_bytes(message, width * dtype.itemsize, path)
    data = bytes(message.data)
    needed = (height - 1) * row_bytes + width * dtype.itemsize if count else 0
    if len(data) < needed:
        raise DataError(path, "point data", f"{len(data)} bytes", f"{needed}")
    points = np.ndarray((height, width), dtype, data, 0, (row_bytes, dtype.itemsize)).ravel()
    known = np.ones(count, dtype=bool)
    for axis in "xyz":
        known &= np.isfinite(points[axis].astype(np.float64))
    return {name: points[name][known] for name in points.dtype.names or ()}


def _row_bytes(message: Any, packed: int, path: Path) -> int:
    """Return the bytes from one row of points to the next; drivers that pad none leave out 0."""
    step = int(message.row_step)
    if step == 0 or int(message.height) <= 1:
        return packed
    if step < packed:
        raise DataError(path, "row_step", step, f"at least {packed}, a row of points")
    return step


def _layout(message: Any, path: Path) -> np.dtype[Any]:
    order = ">" if message.is_bigendian else "<"
    fields = [f for f in message.fields if f.datatype in _TYPES and f.count == 1]
    names = [f.name for f in fields]
    if len(set(names)) != len(names) or not {"x", "y", "z"} <= set(names):
        raise DataError(path, "fields", names, "x, y and z, each name once")
    kinds = [order + _TYPES[f.datatype] for f in fields]
    offsets = [int(f.offset) for f in fields]
    step = int(message.point_step)
    if max(o + np.dtype(k).itemsize for o, k in zip(offsets, kinds, strict=True)) > step:
        raise DataError(path, "point_step", step, "room for every field")
    return np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": step})


class Odometry:
    """The trajectory of the vehicle, interpolated between nav_msgs/msg/Odometry messages."""

    def __init__(self, messages: list[Any], path: Path, max_gap_s: float) -> None:
        self._path, self._max_gap_ns = path, max_gap_s * SECOND_NS
        rows = sorted((_stamp_ns(message), _pose_values(message)) for message in messages)
        self._stamp_ns = np.array([stamp for stamp, _ in rows], dtype=np.int64)
        self._values = np.array([values for _, values in rows]).reshape(-1, 7)

    def at(self, stamp_ns: int) -> Pose:
        """Return `world_T_ego`: positions along the line, headings along the arc between two.

        Raises:
            DataError: no odometry before or after that time within the longest gap, or no pose.
        """
        after = int(np.searchsorted(self._stamp_ns, stamp_ns))
        if after < len(self._stamp_ns) and self._stamp_ns[after] == stamp_ns:
            return self._pose(self._values[after])
        if not 0 < after < len(self._stamp_ns) or self._gap_ns(after) > self._max_gap_ns:
            raise MissingError(self._path, "odometry", "missing", f"messages about {stamp_ns}")
        share = (stamp_ns - self._stamp_ns[after - 1]) / self._gap_ns(after)
        before, later = self._values[after - 1], self._values[after].copy()
        # q and -q are the same rotation: take the one on the side of the first
        later[:4] *= np.sign(before[:4] @ later[:4]) or 1.0
        mixed = (1.0 - share) * before + share * later
        # over a gap of tenths of a second the chord's direction is the arc's
        mixed[:4] /= np.linalg.norm(mixed[:4])
        return self._pose(mixed)

    def _gap_ns(self, after: int) -> int:
        return int(self._stamp_ns[after] - self._stamp_ns[after - 1])

    def _pose(self, values: F64) -> Pose:
        return quaternion_pose(values[:4], values[4:], self._path, "odometry pose")


def _stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    if not 0 <= int(stamp.nanosec) < SECOND_NS:
        raise InputError("nanoseconds of a stamp", int(stamp.nanosec), "less than a second")
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)


def _pose_values(message: Any) -> list[float]:
    """Return the quaternion w, x, y, z and the position x, y, z."""
    # a PoseStamped holds the pose itself, the others a pose with its covariance
    pose = getattr(message.pose, "pose", message.pose)
    q, p = pose.orientation, pose.position
    return [q.w, q.x, q.y, q.z, p.x, p.y, p.z]
