"""Messages of ROS to arrays and poses, whatever file they come from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import DataError
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.ros.trajectory import StampedPose, StampedPoses
from mottrack.datasets.ros.transforms import stamp_of
from mottrack.formats.checks import check_count

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/msg/PointField's numbers of types."""
TIME_FIELDS = ("timestamp", "time_stamp", "t", "time", "offset_time")
"""The names that drivers give to the time of a point: Hesai and Livox, Autoware, Ouster, Velodyne,
Livox' own messages."""
RING_FIELDS = ("ring", "channel")
"""The names of the beam's number: most drivers, Autoware."""
SINCE_1970 = {1e17: 1.0, 1e14: 1e3, 1e8: 1e9}
"""A time above this many units is counted from 1970, in nanoseconds, microseconds or seconds; to
the nanoseconds of the unit. Times since the cloud's stamp are a second at most: 1e9 of the least
unit, and whoever counts in seconds is at 1e9 since 2001."""
MAX_OFFSET_NS = SECOND_NS
"""A revolution takes a tenth of a second; no point of it is a second away from its stamp."""


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
    # a count of 0 is what some drivers write for one
    fields = [f for f in message.fields if f.datatype in _TYPES and f.count in (0, 1)]
    names = [f.name for f in fields]
    if len(set(names)) != len(names) or not {"x", "y", "z"} <= set(names):
        raise DataError(path, "fields", names, "x, y and z, each name once")
    kinds = [order + _TYPES[f.datatype] for f in fields]
    offsets = [int(f.offset) for f in fields]
    step = int(message.point_step)
    if max(o + np.dtype(k).itemsize for o, k in zip(offsets, kinds, strict=True)) > step:
        raise DataError(path, "point_step", step, "room for every field")
    return np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": step})


def time_offsets_ns(columns: dict[str, NDArray[Any]], stamp_ns: int) -> I64 | None:
    """Return when each point was measured, in ns from the stamp (N,); None where that is unknown.

    Floating-point numbers count seconds, integers nanoseconds, from the stamp or from 1970. A field
    that gives a point farther than a second from the stamp holds something else.
    """
    name = next((name for name in TIME_FIELDS if name in columns), None)
    if name is None or not len(columns[name]):
        return None
    values = columns[name]
    whole = values.dtype.kind in "iu"
    if not whole and not np.isfinite(values).all():
        return None
    largest = float(values.max())
    unit_ns = next((ns for least, ns in SINCE_1970.items() if largest > least), None)
    if unit_ns is None:
        offset_ns = values.astype(np.int64) if whole else np.round(values * 1e9).astype(np.int64)
    elif whole:
        offset_ns = values.astype(np.int64) * int(unit_ns) - stamp_ns
    else:
        # the difference first: a double since 1970 resolves 0.2 microseconds, a product less
        since = values.astype(np.float64) - stamp_ns / unit_ns
        offset_ns = np.round(since * unit_ns).astype(np.int64)
    return offset_ns if np.abs(offset_ns).max() <= MAX_OFFSET_NS else None


def odometry_poses(messages: list[Any]) -> StampedPoses:
    """Return the poses of Odometry, PoseStamped or PoseWithCovarianceStamped messages."""
    return StampedPoses.of([StampedPose(stamp_of(m.header), _pose_values(m)) for m in messages])


def _pose_values(message: Any) -> list[float]:
    # a PoseStamped holds the pose itself, the others a pose with its covariance
    return pose_values(getattr(message.pose, "pose", message.pose))


def pose_values(pose: Any) -> list[float]:
    """Return the quaternion w, x, y, z and the position x, y, z of a geometry_msgs/Pose."""
    q, p = pose.orientation, pose.position
    return [q.w, q.x, q.y, q.z, p.x, p.y, p.z]


def xyz_of(columns: dict[str, NDArray[Any]]) -> F64:
    """Return the coordinates (N, 3) of point columns."""
    return np.column_stack([columns[axis].astype(np.float64) for axis in "xyz"])
