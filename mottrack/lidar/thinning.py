"""Fewer points where there are many: the first point of each voxel."""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I64
from mottrack.core.checks import as_array


def first_in_voxel(xyz_m: F32, voxel_m: float) -> I64:
    """Indices, ascending, of the first point of (N, 3) in each cube of `voxel_m` metres.

    Points farther than 2^20 voxels from the origin may share the voxel of another one.

    Raises:
        InputError: the shape is another.
    """
    points = np.array(as_array("xyz_m", xyz_m, np.float32, (None, 3)))
    return np.asarray(_first(points, voxel_m))


@compiled
def _first(xyz_m: F32, voxel_m: float) -> I64:
    size = 1
    while size < 2 * len(xyz_m) + 1:
        size *= 2
    table = np.full(size, -1, np.int64)
    first = np.empty(len(xyz_m), np.int64)
    count = 0
    per_voxel = 1.0 / voxel_m
    for i in range(len(xyz_m)):
        x = np.int64(np.floor(xyz_m[i, 0] * per_voxel)) + (1 << 20)
        y = np.int64(np.floor(xyz_m[i, 1] * per_voxel)) + (1 << 20)
        z = np.int64(np.floor(xyz_m[i, 2] * per_voxel)) + (1 << 20)
        key = (x << 42) | (y << 21) | z
        slot = ((key * 0x9E3779B97F4A7C1) >> 20) & (size - 1)
        while table[slot] != -1 and table[slot] != key:
            slot = (slot + 1) & (size - 1)
        if table[slot] == -1:
            table[slot] = key
            first[count] = i
            count += 1
    return first[:count].copy()
