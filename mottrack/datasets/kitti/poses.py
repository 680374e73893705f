"""Calibration and ego poses of a KITTI sequence.

Poses come from a file of camera poses or from KITTI's GPS/IMU files, as `world_T_ego` of each
frame. The world is z-up and starts at the first frame:

* from `poses/<sequence>.txt` (twelve numbers a frame, row-major 3 x 4 `map_T_camera`) the world
  is the ego frame of the first frame, since such a map knows no gravity;
* from `oxts/<sequence>.txt` the world has its axes east, north, up, and its origin where the
  first frame's ego frame was.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core import Pose
from mottrack.core.arrays import F64
from mottrack.core.errors import DataError
from mottrack.formats.checks import MAX_ANGLE_RAD
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.faults import MissingError
from mottrack.formats.rigid import rigid_pose
from mottrack.formats.text_rows import Layout, finite_values, read_lines, read_text_columns

# The tracking and the object benchmark spell the same matrices differently.
_NAMES = {
    "P2": "P2",
    "R0_rect": "R_rect",
    "R_rect": "R_rect",
    "Tr_velo_to_cam": "Tr_velo_cam",
    "Tr_velo_cam": "Tr_velo_cam",
    "Tr_imu_to_velo": "Tr_imu_velo",
    "Tr_imu_velo": "Tr_imu_velo",
}
_VALUES = {"P2": 12, "R_rect": 9, "Tr_velo_cam": 12, "Tr_imu_velo": 12}
EARTH_RADIUS_M = 6_378_137.0
"""Equatorial radius of WGS 84, as KITTI's development kit has it."""
_MATRIX = tuple(f"T[{i // 4},{i % 4}]" for i in range(12))
_ANGLES = ("roll", "pitch", "yaw")
_OXTS_USED = specs("lat", "lon", "alt", *_ANGLES)
_OXTS_FURTHER = 24
"""The other fields of KITTI's 30: velocities, accelerations, accuracies and states."""
_OXTS_LIMIT = {"lat": 85.0, "lon": 180.0, "alt": 1e5} | dict.fromkeys(_ANGLES, MAX_ANGLE_RAD)
"""Largest magnitude of each: degrees (the projection ends near the poles), metres, radians."""


@dataclass(frozen=True)
class Calibration:
    """The matrices of a KITTI calibration that the reader uses.

    ego_T_camera: rectified left camera -> ego (Velodyne).
    ego_T_imu: GPS/IMU unit -> ego.
    field_of_view_rad: (right, left) azimuth in the ego frame between which the colour camera sees.
    projection: (3, 4) rectified left camera -> pixels of the left colour camera, P2.
    """

    ego_T_camera: Pose
    ego_T_imu: Pose
    field_of_view_rad: tuple[float, float]
    projection: F64


def read_calibration(path: Path) -> Calibration:
    """Read `calib/<sequence>.txt`.

    Raises:
        DataError: a matrix is missing, has the wrong number of values, is not a rotation, or
            projects nothing into the image.
    """
    matrices = _read_matrices(path)
    rectified = np.eye(4)
    rectified[:3, :3] = matrices["R_rect"].reshape(3, 3)
    velodyne = np.vstack([matrices["Tr_velo_cam"].reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
    camera_T_ego = rigid_pose(rectified @ velodyne, path, "R_rect x Tr_velo_cam")
    ego_T_imu = rigid_pose(matrices["Tr_imu_velo"].reshape(3, 4), path, "Tr_imu_velo")
    field_of_view_rad = _field_of_view(path, matrices["P2"])
    projection = matrices["P2"].reshape(3, 4)
    return Calibration(camera_T_ego.inverse(), ego_T_imu, field_of_view_rad, projection)


def _field_of_view(path: Path, projection: F64) -> tuple[float, float]:
    """Return the azimuths of the edges of an image that is symmetric about the principal point.

    KITTI's images are cut to slightly different widths that no text file records; twice the
    principal point is up to 2 % narrower than the image, so nothing unlabelled is inside.
    """
    if projection[0] <= 0.0 or projection[2] <= 0.0:
        value = f"focal length {projection[0]:g}, principal point {projection[2]:g}"
        raise DataError(path, "P2", value, "both above 0 pixels")
    half = float(np.arctan2(projection[2], projection[0]))
    return -half, half


def _read_matrices(path: Path) -> dict[str, F64]:
    matrices: dict[str, F64] = {}
    for number, line in enumerate(read_lines(path), start=1):
        key, _, values = line.strip().partition(" ")
        name = _NAMES.get(key.rstrip(":"))
        if name in matrices:
            raise DataError(path, f"line {number}", f"{key} again", "each matrix once")
        if name is not None:
            matrices[name] = _parse_matrix(path, f"line {number}, {key}", values, _VALUES[name])
    for name in _VALUES:
        if name not in matrices:
            raise DataError(path, name, "missing", f"a line with {_VALUES[name]} values")
    return matrices


def _parse_matrix(path: Path, where: str, text: str, count: int) -> F64:
    words = text.split()
    if len(words) != count:
        raise DataError(path, where, f"{len(words)} values", f"{count} numbers")
    return np.array(finite_values(path, where, words))


def read_camera_poses(path: Path, calibration: Calibration) -> list[Pose]:
    """Read `map_T_camera` rows as `world_T_ego`, the world being the first ego frame.

    Raises:
        DataError: no line, a broken one, or a matrix that is not rigid.
    """
    table = _rows(path, specs(*_MATRIX), further=0)
    camera_T_ego = calibration.ego_T_camera.inverse()
    map_T_ego = [
        rigid_pose(row.reshape(3, 4), path, f"line {line}") @ camera_T_ego
        for row, line in zip(table.stacked(_MATRIX), table.row, strict=True)
    ]
    return [map_T_ego[0].inverse() @ pose for pose in map_T_ego]


def read_oxts(path: Path, calibration: Calibration) -> list[Pose]:
    """Read `oxts/<sequence>.txt` as `world_T_ego`, east-north-up from the first frame.

    Positions follow the Mercator projection at the scale of the first frame's latitude, as in
    Geiger et al., "Vision meets robotics: the KITTI dataset", IJRR 2013, section on the IMU.

    Raises:
        DataError: no line, a broken one, or a value that is not finite or out of range.
    """
    table = _rows(path, _OXTS_USED, further=_OXTS_FURTHER)
    for name, limit in _OXTS_LIMIT.items():
        table.refuse(name, np.abs(table[name]) > limit, f"within {limit:g}")
    imu_T_ego = calibration.ego_T_imu.inverse()
    map_T_ego = [
        Pose(_rotation(*angles), position) @ imu_T_ego
        for angles, position in zip(table.stacked(_ANGLES), _mercator(table), strict=True)
    ]
    origin = Pose(np.eye(3), -map_T_ego[0].translation_m)
    return [origin @ pose for pose in map_T_ego]


def _rows(path: Path, columns: tuple[ColumnSpec, ...], *, further: int) -> Columns:
    table = read_text_columns(path, columns, Layout(optional=further))
    if not len(table):
        raise MissingError(path, "lines", 0, "one for each frame")
    return table


def _mercator(table: Columns) -> F64:
    lat, lon = np.radians(table["lat"]), np.radians(table["lon"])
    scale = np.cos(lat[0]) * EARTH_RADIUS_M
    north = scale * np.log(np.tan(np.pi / 4.0 + lat / 2.0))
    return np.column_stack([scale * lon, north, table["alt"]])


def _rotation(roll: float, pitch: float, yaw: float) -> F64:
    """Return Rz(yaw) Ry(pitch) Rx(roll), yaw counted from east, counter-clockwise."""
    (sr, cr), (sp, cp), (sy, cy) = ((np.sin(a), np.cos(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    rotation: F64 = about_z @ about_y @ about_x
    return rotation
