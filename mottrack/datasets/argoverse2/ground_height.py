"""The map's ground height: a raster over the city frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.arrays import F32, F64
from mottrack.core.errors import DataError
from mottrack.core.npz import unpacked_npy
from mottrack.formats.files import read_bytes
from mottrack.formats.json_text import parse_json
from mottrack.formats.rigid import MAX_DEFECT

MAX_HEIGHT_M = 1e4
"""Of the ground over the city's origin: no mountain is higher."""


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
    data = read_bytes(path)
    try:
        values = unpacked_npy(data)
    except ValueError as error:
        raise DataError(path, "content", error, "an npy file") from error
    if values.ndim != 2 or values.dtype.kind != "f":
        raise DataError(path, "raster", f"{values.dtype} {values.shape}", "(H, W) numbers")
    # NaN is where the map does not know the height
    if np.isinf(values).any() or np.nanmax(np.abs(values), initial=0.0) > MAX_HEIGHT_M:
        worst = np.nanmax(np.abs(values))
        raise DataError(path, "raster", f"up to {worst}", f"heights within {MAX_HEIGHT_M:g} m")
    return np.asarray(values, dtype=np.float32)


def _with_transform(path: Path, height_m: F32) -> GroundHeight:
    try:
        values: dict[str, Any] = parse_json(path, read_bytes(path))
        rotation = np.array(values["R"], dtype=np.float64).reshape(2, 2)
        translation = np.array(values["t"], dtype=np.float64).reshape(2)
        scale = float(values["s"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise DataError(
            path, "transform", f"unreadable ({type(error).__name__}: {error})", "R (4), t (2), s"
        ) from error
    off = np.abs(rotation @ rotation.T - np.eye(2)).max()
    if not off < MAX_DEFECT or not np.isfinite(translation).all() or not 0.0 < scale < np.inf:
        raise DataError(path, "transform", values, "a rotation R, a finite t and a positive s")
    return GroundHeight(height_m, rotation, translation, scale)
