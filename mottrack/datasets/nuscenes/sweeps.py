"""LIDAR_TOP sweeps: `.pcd.bin`, float32 x, y, z, intensity, ring, in the sensor's own frame.

The published files are already motion-compensated to their time stamp.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mottrack.core import DataError, Pose, Sweep
from mottrack.core.arrays import F32, F64
from mottrack.datasets.files import check_range, read_floats
from mottrack.datasets.rigid import quaternion_pose

INTENSITY_MAX = 255.0


def read_sweep(path: Path, stamp_ns: int, world_T_ego: Pose, ego_T_lidar: F64) -> Sweep:
    """Read one sweep into the ego frame.

    Args:
        path: the `.pcd.bin` file.
        stamp_ns: its time.
        world_T_ego: pose at that time.
        ego_T_lidar: (7,) mounting, quaternion w, x, y, z and translation.

    Raises:
        DataError: missing, empty or cut file, a value that is not finite or out of range.

    """
    values = read_floats(path, 5)
    check_range(path, values[:, :3])
    intensity, ring = values[:, 3], values[:, 4]
    _check(path, "intensity", intensity, INTENSITY_MAX)
    _check(path, "ring", ring, 1023.0)
    mounting = quaternion_pose(ego_T_lidar[:4], ego_T_lidar[4:], path, "mounting")
    return Sweep(
        xyz_m=mounting.apply(values[:, :3]).astype(np.float32),
        reflectance=intensity / np.float32(INTENSITY_MAX),
        stamp_ns=stamp_ns,
        world_T_ego=world_T_ego,
        origin_m=mounting.translation_m,
        ring=ring.astype(np.int16),
    )


def _check(path: Path, name: str, values: F32, highest: float) -> None:
    bad = np.flatnonzero((values < 0.0) | (values > highest))
    if bad.size:
        expected = f"within [0, {highest:g}]"
        raise DataError(path, f"{name} of point {bad[0]}", float(values[bad[0]]), expected)
