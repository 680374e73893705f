"""Points of one LiDAR in the files of the dialects of nuScenes, in the sensor's own frame."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F32, F64, I16, I64
from mottrack.formats.checks import (
    check_interval,
    check_points,
    check_rings,
    read_float_rows,
)
from mottrack.formats.pcd import read_pcd

INTENSITY_MAX = 255.0
"""Intensities are stored as the sensor's eight bits."""
MOST_INTENSITY = 65535.0
"""Some drivers write sixteen bits; a larger number is a damaged file."""


class Points(NamedTuple):
    """N points.

    xyz_m: (N, 3). reflectance: (N,) in [0, 1].
    ring: (N,) beam; None where the format has none.
    stamp_us: (N,) when each was measured; None where the format does not say.
    """

    xyz_m: F32 | F64
    reflectance: F32
    ring: I16 | None = None
    stamp_us: I64 | None = None


def read_nuscenes_points(path: Path) -> Points:
    """Read `.pcd.bin` of nuScenes: float32 x, y, z, intensity, ring.

    Raises:
        DataError: missing, empty or cut file, a value that is not finite or out of range.
    """
    values = read_float_rows(path, 5)
    check_points(path, values[:, :3])
    check_interval(path, "intensity", values[:, 3], INTENSITY_MAX)
    ring = check_rings(path, values[:, 4])
    return Points(values[:, :3], values[:, 3] / np.float32(INTENSITY_MAX), ring)


def read_t4_points(path: Path) -> Points:
    """Read `.pcd.bin` of T4: float32 x, y, z, intensity, and a ring that is no longer used (-1).

    Intensities above 255, which drivers in Autoware write for retroreflectors, count as 255.

    Raises:
        DataError: missing, empty or cut file, or a value that is not finite.
    """
    values = read_float_rows(path, 5)
    check_points(path, values[:, :3])
    return Points(values[:, :3], _clipped(path, values[:, 3]))


def read_truckscenes_points(path: Path) -> Points:
    """Read `.pcd` of TruckScenes: x, y, z, intensity and the time of each point in microseconds.

    Raises:
        DataError: missing or damaged file, or a value that is not finite.
    """
    fields = read_pcd(path, ("x", "y", "z", "intensity"), ("timestamp",))
    xyz_m = np.column_stack([fields[axis].astype(np.float64) for axis in "xyz"])
    check_points(path, xyz_m)
    reflectance = _clipped(path, fields["intensity"].astype(np.float32))
    stamps = fields.get("timestamp")
    if stamps is None or stamps.dtype.kind not in "ui":
        return Points(xyz_m, reflectance)
    return Points(xyz_m, reflectance, None, stamps.astype(np.int64))


def _clipped(path: Path, intensity: F32) -> F32:
    """Return reflectances (N,) of intensities of eight bits; larger ones are 1."""
    check_interval(path, "intensity", intensity, MOST_INTENSITY)
    top = np.minimum(intensity, np.float32(INTENSITY_MAX))
    return (top / np.float32(INTENSITY_MAX)).astype(np.float32)
