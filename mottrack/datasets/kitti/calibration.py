"""KITTI calibration files: pose of the rectified camera in the ego (Velodyne) frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core import Pose
from mottrack.core.arrays import F64
from mottrack.core.errors import DataError
from mottrack.datasets.rigid import rigid_pose
from mottrack.formats.text_rows import read_lines

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


@dataclass(frozen=True)
class Calibration:
    """The matrices of a KITTI calibration that the reader uses.

    ego_T_camera: rectified left camera -> ego (Velodyne).
    ego_T_imu: GPS/IMU unit -> ego.
    field_of_view_rad: (right, left) azimuth in the ego frame between which the colour camera sees.
    """

    ego_T_camera: Pose
    ego_T_imu: Pose
    field_of_view_rad: tuple[float, float]


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
    return Calibration(camera_T_ego.inverse(), ego_T_imu, _field_of_view(path, matrices["P2"]))


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
        if name is not None:
            matrices[name] = _parse_matrix(path, f"line {number}, {key}", values, _VALUES[name])
    for name in _VALUES:
        if name not in matrices:
            raise DataError(path, name, "missing", f"a line with {_VALUES[name]} values")
    return matrices


def _parse_matrix(path: Path, where: str, text: str, count: int) -> F64:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise DataError(path, where, text.strip(), f"{count} numbers") from error
    if values.shape != (count,) or not np.isfinite(values).all():
        raise DataError(path, where, text.strip(), f"{count} finite numbers")
    return values
