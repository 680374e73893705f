"""sensor_msgs/msg/PointCloud2 to arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import DataError

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def point_columns(message: Any, path: Path) -> dict[str, NDArray[Any]]:
    """Return each field of the cloud as an array (N,), without the points that are NaN.

    Drivers mark a beam without return by NaN coordinates, so those are no fault here.

    Raises:
        DataError: the size of the data does not fit its description, or x, y, z are missing.

    """
    dtype = _layout(message, path)
    count = int(message.width) * int(message.height)
    data = bytes(message.data)
    if len(data) < count * dtype.itemsize:
        raise DataError(path, "point data", f"{len(data)} bytes", f"{count * dtype.itemsize}")
    points = np.frombuffer(data, dtype=dtype, count=count)
    names = points.dtype.names or ()
    known = np.ones(count, dtype=bool)
    for axis in "xyz":
        known &= np.isfinite(points[axis].astype(np.float64))
    return {name: points[name][known] for name in names}


def _layout(message: Any, path: Path) -> np.dtype[Any]:
    order = ">" if message.is_bigendian else "<"
    fields = [f for f in message.fields if f.datatype in _TYPES and f.count == 1]
    names = [f.name for f in fields]
    if len(set(names)) != len(names) or not {"x", "y", "z"} <= set(names):
        raise DataError(path, "fields", names, "x, y and z, each name once")
    kinds = [order + _TYPES[f.datatype] for f in fields]
    offsets = [int(f.offset) for f in fields]
    step = int(message.point_step)
    if max(o + np.dtype(k).itemsize for o, k in zip(offsets, kinds, strict=True)) > step:
        raise DataError(path, "point_step", step, "room for every field")
    return np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": step})
