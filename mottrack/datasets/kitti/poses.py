"""Where the vehicle stood: a file of camera poses, or KITTI's GPS/IMU files.

Both come out as `world_T_ego` of each frame. The world is z-up and starts at the first frame:

* from `poses/<sequence>.txt` (twelve numbers a frame, row-major 3 x 4 `map_T_camera`) the world
  is the ego frame of the first frame, since such a map knows no gravity;
* from `oxts/<sequence>.txt` the world has its axes east, north, up, and its origin where the
  first frame's ego frame was.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import Pose
from mottrack.core.arrays import F64
from mottrack.datasets.faults import MissingError
from mottrack.datasets.files import MAX_ANGLE_RAD, Column, read_table, refuse_rows
from mottrack.datasets.kitti.calibration import Calibration
from mottrack.datasets.rigid import rigid_pose

EARTH_RADIUS_M = 6_378_137.0
_MATRIX = tuple(Column(f"T[{i // 4},{i % 4}]") for i in range(12))
_OXTS_USED = tuple(Column(name) for name in ("lat", "lon", "alt", "roll", "pitch", "yaw"))
_OXTS_FURTHER = 24
_OXTS_LIMIT = {"lat": 85.0, "lon": 180.0, "alt": 1e5} | dict.fromkeys(
    ("roll", "pitch", "yaw"), MAX_ANGLE_RAD
)
"""Largest magnitude of each: degrees (the projection ends near the poles), metres, radians."""


def read_camera_poses(path: Path, calibration: Calibration) -> list[Pose]:
    """Read `map_T_camera` rows as `world_T_ego`, the world being the first ego frame.

    Raises:
        DataError: no line, a broken one, or a matrix that is not rigid.

    """
    table = _one_row_a_frame(path, read_table(path, _MATRIX))
    rows = np.column_stack([table[column.name] for column in _MATRIX])
    camera_T_ego = calibration.ego_T_camera.inverse()
    map_T_ego = [
        rigid_pose(row.reshape(3, 4), path, f"line {line}") @ camera_T_ego
        for row, line in zip(rows, table["line"], strict=True)
    ]
    return [map_T_ego[0].inverse() @ pose for pose in map_T_ego]


def read_oxts(path: Path, calibration: Calibration) -> list[Pose]:
    """Read `oxts/<sequence>.txt` as `world_T_ego`, east-north-up from the first frame.

    Positions follow the Mercator projection at the scale of the first frame's latitude, as in
    Geiger et al., "Vision meets robotics: the KITTI dataset", IJRR 2013, section on the IMU.

    Raises:
        DataError: no line, a broken one, or a value that is not finite or out of range.

    """
    table = _one_row_a_frame(path, read_table(path, _OXTS_USED, optional=_OXTS_FURTHER))
    for name, limit in _OXTS_LIMIT.items():
        refuse_rows(path, table, np.abs(table[name]) > limit, name, f"within {limit:g}")
    position = _mercator(table)
    imu_T_ego = calibration.ego_T_imu.inverse()
    map_T_ego = [
        Pose(_rotation(table["roll"][i], table["pitch"][i], table["yaw"][i]), position[i])
        @ imu_T_ego
        for i in range(len(position))
    ]
    origin = Pose(np.eye(3), -map_T_ego[0].translation_m)
    return [origin @ pose for pose in map_T_ego]


def _one_row_a_frame(path: Path, table: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    if not len(table["line"]):
        raise MissingError(path, "lines", 0, "one for each frame")
    return table


def _mercator(table: dict[str, NDArray[Any]]) -> F64:
    lat, lon = np.radians(table["lat"]), np.radians(table["lon"])
    scale = np.cos(lat[0]) * EARTH_RADIUS_M
    north = scale * np.log(np.tan(np.pi / 4.0 + lat / 2.0))
    return np.column_stack([scale * lon, north, table["alt"]])


def _rotation(roll: float, pitch: float, yaw: float) -> F64:
    """Rz(yaw) Ry(pitch) Rx(roll), yaw counted from east, counter-clockwise."""
    (sr, cr), (sp, cp), (sy, cy) = ((np.sin(a), np.cos(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    turned: F64 = about_z @ about_y @ about_x
    return turned
