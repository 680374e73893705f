"""Keeps the key frames of a scene for pictures, thinned to what a picture can show."""

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
VOXELS = 2**15
"""In each direction of each axis: 8 km, beyond which all is one."""
OCCUPIED_SHARE = 0.7
"""Share of the points that is meant for what stands on the ground."""


@dataclass
class SnapshotRecorder:
    """Takes every key frame of a scene."""

    points: int
    """How many points a key frame keeps at most."""
    snapshots: list[Snapshot] = field(default_factory=list)

    def take(
        self, row: int, sweep: Sweep | None, field: FlowField | None, objects: Objects | None
    ) -> None:
        """Keeps a key frame, row ``row`` of the FrameTable."""
        xyz_m = np.zeros((0, 3), np.float32) if sweep is None else sweep.xyz_m
        thin_m = thinned(xyz_m, field, self.points)
        self.snapshots.append(Snapshot.of(row, thin_m, field, objects))


class NullRecorder(SnapshotRecorder):
    """Takes nothing: of this scene no pictures are wanted."""

    def take(
        self, row: int, sweep: Sweep | None, field: FlowField | None, objects: Objects | None
    ) -> None:
        """Lets the key frame go."""


def thinned(xyz_m: F32, field: FlowField | None, limit: int) -> F32:
    """At most ``limit`` of the points (N, 3), the same ones for the same sweep.

    One point of a voxel stays; of those, so many as are wanted in equal steps through space. Most
    are taken from occupied cells, so that the road does not hide what stands on it.
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
    points: F32 = xyz_m[kept]
    return points


def _every_few(index: NDArray[np.intp], limit: int) -> NDArray[np.intp]:
    if len(index) <= limit:
        return index
    return index[np.linspace(0, len(index) - 1, limit).round().astype(np.intp)]
