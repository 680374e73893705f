"""`city_SE3_egovehicle.feather`: where the vehicle stood."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mottrack.core import Pose
from mottrack.core.errors import DataError
from mottrack.datasets.argoverse2.feather import (
    POSE,
    read_columns,
    refuse,
    require_integers,
    stacked,
)
from mottrack.datasets.rigid import quaternion_pose

UP_LIDAR = "up_lidar"


def read_poses(path: Path) -> dict[int, Pose]:
    """Return `world_T_ego` by time in nanoseconds; the world is Argoverse's city frame.

    Raises:
        DataError: damaged file, a stamp twice, a place far from Earth, or a quaternion that is not
            a unit one.

    """
    columns = read_columns(path, ("timestamp_ns", *POSE))
    stamps = require_integers(path, columns, "timestamp_ns")
    values = stacked(columns, POSE)
    repeated = np.ones(len(stamps), dtype=bool)
    repeated[np.unique(stamps, return_index=True)[1]] = False
    refuse(path, repeated, "timestamp_ns", stamps, "each stamp once")
    return {
        int(stamp): quaternion_pose(row[:4], row[4:], path, f"pose of row {number}")
        for number, (stamp, row) in enumerate(zip(stamps, values, strict=True))
    }


def read_lidar_origin(path: Path) -> tuple[float, float, float]:
    """Return the upper LiDAR's place in the ego frame from `egovehicle_SE3_sensor.feather`.

    Both LiDARs are stacked on one axis within 30 cm of each other; the upper one stands for both.

    Raises:
        DataError: damaged file, no such sensor, or a mounting that is not rigid.

    """
    columns = read_columns(path, POSE, ("sensor_name",))
    rows = np.flatnonzero(columns["sensor_name"] == UP_LIDAR)
    if not rows.size:
        raise DataError(path, "sensor_name", "others only", UP_LIDAR)
    values = stacked(columns, POSE)[rows[0]]
    place = quaternion_pose(values[:4], values[4:], path, f"mounting of {UP_LIDAR}").translation_m
    return float(place[0]), float(place[1]), float(place[2])
