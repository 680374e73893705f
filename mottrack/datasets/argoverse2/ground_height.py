"""The map's ground height: a raster over the city frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from mottrack.core.arrays import F32, F64
from mottrack.core.errors import DataError
from mottrack.datasets.rigid import MAX_DEFECT
from mottrack.formats.files import read_bytes


@dataclass(frozen=True)
class GroundHeight:
    """Height of the ground by place; cell (column, row) of a point is floor(s (R xy + t)).

    height_m: (H, W) raster, NaN where unknown; rows follow the city's y, columns its x.
    rotation: (2, 2) R. translation: (2,) t in metres. scale: s in cells per metre.
    """

    height_m: F32
    rotation: F64
    translation: F64
    scale: float

    def at(self, xy_m: F64) -> F64:
        """Return the height (N,) at (N, 2) places of the world; NaN outside the map."""
        cell = np.floor(self.scale * (xy_m @ self.rotation.T + self.translation)).astype(int)
        column, row = cell.T
        height, width = self.height_m.shape
        known = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        result = np.full(len(xy_m), np.nan)
        result[known] = self.height_m[row[known], column[known]]
        return result


def read_ground_height(folder: Path) -> GroundHeight | None:
    """Read the raster of a log's `map` folder; None where there is none.

    Raises:
        DataError: a file of it is damaged, or only one of the two is there.
    """
    rasters = sorted(folder.glob("*_ground_height_surface____*.npy"))
    transforms = sorted(folder.glob("*___img_Sim2_city.json"))
    if not rasters and not transforms:
        return None
    if len(rasters) != 1 or len(transforms) != 1:
        found = f"{len(rasters)} rasters, {len(transforms)} transforms"
        raise DataError(folder, "ground height", found, "one raster and one img_Sim2_city.json")
    return _with_transform(transforms[0], _raster(rasters[0]))


def _raster(path: Path) -> F32:
    try:
        values = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DataError(path, "content", f"unreadable ({error})", "an npy file") from error
    if values.ndim != 2 or values.dtype.kind != "f":
        raise DataError(path, "raster", f"{values.dtype} {values.shape}", "(H, W) numbers")
    return np.asarray(values, dtype=np.float32)


def _with_transform(path: Path, height_m: F32) -> GroundHeight:
    try:
        values: dict[str, Any] = orjson.loads(read_bytes(path))
        rotation = np.array(values["R"], dtype=np.float64).reshape(2, 2)
        translation = np.array(values["t"], dtype=np.float64).reshape(2)
        scale = float(values["s"])
    except (orjson.JSONDecodeError, KeyError, TypeError, ValueError) as error:
        raise DataError(path, "transform", f"unreadable ({error})", "R (4), t (2), s") from error
    off = np.abs(rotation @ rotation.T - np.eye(2)).max()
    if not off < MAX_DEFECT or not np.isfinite(translation).all() or not scale > 0.0:
        raise DataError(path, "transform", values, "a rotation R, a finite t and a positive s")
    return GroundHeight(height_m, rotation, translation, scale)
