"""Sweeps of an own log: raw float32 or npz."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import DataError, InputError, Pose, Sweep
from mottrack.datasets.checks import check_interval, check_points, read_float_rows


def sweep_file(folder: Path, stamp_ns: int) -> Path:
    """Return the npz of a stamp where there is one, else the bin."""
    npz = folder / f"{stamp_ns}.npz"
    return npz if npz.is_file() else folder / f"{stamp_ns}.bin"


def read_sweep(path: Path, stamp_ns: int, world_T_ego: Pose, origin_m: Sequence[float]) -> Sweep:
    """Read one sweep; `origin_m` (3,) is the LiDAR's optical centre in the ego frame.

    Raises:
        DataError: missing or damaged file, a value that is not finite or out of range.
    """
    arrays = _npz(path) if path.suffix == ".npz" else _bin(path)
    check_points(path, arrays["xyz_m"])
    check_interval(path, "reflectance", arrays["reflectance"], 1.0)
    try:
        return Sweep(
            stamp_ns=stamp_ns, world_T_ego=world_T_ego, origin_m=np.array(origin_m), **arrays
        )
    except InputError as error:
        raise DataError(path, error.field, error.value, error.expected) from error


def _bin(path: Path) -> dict[str, NDArray[Any]]:
    values = read_float_rows(path, 4)
    return {"xyz_m": values[:, :3], "reflectance": values[:, 3]}


def _npz(path: Path) -> dict[str, NDArray[Any]]:
    wanted = {"xyz_m", "reflectance", "time_offset_ns", "ring"}
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files if name in wanted}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DataError(path, "content", f"unreadable ({error})", "an npz file") from error
    for name, dimensions in (("xyz_m", 2), ("reflectance", 1)):
        array = arrays.get(name)
        if array is None or array.ndim != dimensions or array.dtype.kind not in "fiu":
            found = "missing" if array is None else f"{array.dtype} {array.shape}"
            raise DataError(path, name, found, "xyz_m (N, 3) and reflectance (N,) numbers")
    if arrays["xyz_m"].shape[1] != 3 or len(arrays["xyz_m"]) != len(arrays["reflectance"]):
        shapes = f"{arrays['xyz_m'].shape}, {arrays['reflectance'].shape}"
        raise DataError(path, "shapes", shapes, "(N, 3), (N,)")
    return arrays
