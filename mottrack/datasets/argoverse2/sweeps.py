"""Feather sweeps: x, y, z in the ego frame, motion-compensated, intensity 0 to 255."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mottrack.core import DataError, Pose, Sweep
from mottrack.datasets.argoverse2.feather import read_columns, refuse, require_integers, stacked
from mottrack.datasets.files import check_range

_COLUMNS = ("x", "y", "z", "intensity", "laser_number", "offset_ns")


def sweep_stamps(folder: Path) -> list[int]:
    """Return the times in nanoseconds for which there is a sweep, ascending."""
    return sorted(int(p.stem) for p in folder.glob("*.feather") if p.stem.isdigit())


def read_sweep(
    path: Path, stamp_ns: int, world_T_ego: Pose, origin_m: tuple[float, float, float]
) -> Sweep:
    """Read one sweep.

    Raises:
        DataError: missing or damaged file, no points, a value that is not finite or out of range.

    """
    columns = read_columns(path, _COLUMNS)
    xyz_m = stacked(columns, ("x", "y", "z"))
    if not len(xyz_m):
        raise DataError(path, "points", 0, "at least one")
    check_range(path, xyz_m)
    intensity = columns["intensity"].astype(np.float64)
    refuse(path, (intensity < 0) | (intensity > 255), "intensity", intensity, "in [0, 255]")
    return Sweep(
        xyz_m=xyz_m.astype(np.float32),
        reflectance=(intensity / 255.0).astype(np.float32),
        stamp_ns=stamp_ns,
        world_T_ego=world_T_ego,
        origin_m=np.array(origin_m),
        time_offset_ns=require_integers(path, columns, "offset_ns"),
        ring=require_integers(path, columns, "laser_number").astype(np.int16),
    )
