"""Recording of key frames for pictures, with thinned point clouds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32
from mottrack.core.motion import FlowField
from mottrack.core.objects import Objects
from mottrack.core.snapshot import Snapshot
from mottrack.core.sweep import Sweep

VOXEL_M = (0.25, 0.25, 0.5)
"""One point of each is kept: the cell of the default grid, and half a metre of height, which a
bird's-eye picture does not show."""
VOXELS = 2**15
"""Per direction and axis: three axes of 16 bits fit into one int64 key. Points beyond 8 km are
clipped to the last voxel."""
OCCUPIED_SHARE = 0.7
"""Share of the points for occupied cells, so that the road does not hide the objects on it."""


@dataclass
class SnapshotRecorder:
    """Records the key frames of a scene, or nothing where it is not enabled."""

    points: int
    """Maximum number of points per key frame."""
    enabled: bool = True
    snapshots: list[Snapshot] = field(default_factory=list)

    def take(
        self, row: int, sweep: Sweep | None, field: FlowField | None, objects: Objects | None
    ) -> None:
        """Record a key frame, row ``row`` of the FrameTable."""
        if not self.enabled:
            return
        xyz_m = np.zeros((0, 3), np.float32) if sweep is None else sweep.xyz_m
        thin_m = thinned(xyz_m, field, self.points)
        self.snapshots.append(Snapshot.of(row, thin_m, field, objects))


def thinned(xyz_m: F32, field: FlowField | None, limit: int) -> F32:
    """Return at most ``limit`` of the points (N, 3); deterministic.

    One point of each voxel is kept; of those, ``limit`` in equal steps through space, most of them
    from occupied cells.
    """
    voxel = np.clip(np.floor(xyz_m / VOXEL_M), -VOXELS, VOXELS - 1).astype(np.int64) + VOXELS
    key = (voxel[:, 0] * 2 * VOXELS + voxel[:, 1]) * 2 * VOXELS + voxel[:, 2]
    _, first = np.unique(key, return_index=True)
    standing = np.zeros(len(first), np.bool_)
    if field is not None:
        row, column, inside = field.grid.cells(xyz_m[first])
        standing = inside & field.occupied[row, column]
    tall, flat = first[standing], first[~standing]
    share = max(round(OCCUPIED_SHARE * limit), limit - len(flat))
    tall = _every_few(tall, share)
    kept = np.sort(np.concatenate([tall, _every_few(flat, limit - len(tall))]))
    return np.asarray(xyz_m[kept])


def _every_few(index: NDArray[np.intp], limit: int) -> NDArray[np.intp]:
    if len(index) <= limit:
        return index
    return index[np.linspace(0, len(index) - 1, limit).round().astype(np.intp)]
