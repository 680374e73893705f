"""Points, flow and objects of the key frames of a scene, kept for pictures and viewers.

A file of snapshots is an ``npz`` with a checksum (``core.storage``), whose arrays hold the key
frames one after the other:

    format     version of this layout
    frame      (T,) row of the scene's FrameTable
    grid       (T, 5) x_min_m, x_max_m, y_min_m, y_max_m, cell_m
    counts     (T, 3) how many points, cells and objects each key frame has
    xyz_cm     (points, 3) int16, ego frame
    cells      (cells, 2) uint16, row and column in the grid
    flow_cmps  (cells, 2) int16, ego axes
    valid      (cells,) whether the source measured the cell
    objects.*  (objects, ...) a column of ObjectTable each, world frame; in float32 but for the
               centres: map coordinates of 4e6 m would be off by a quarter of a metre
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32, F64, I16, I64, Floats, Mask, Texts
from mottrack.core.checks import Column, Columns
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.objects import Objects
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.core.tables import Table

FORMAT = "mottrack snapshots 2"
STEP = 0.01
"""Points are stored in centimetres, the flow in cm/s: finer than a screen or the sensor."""


@dataclass(frozen=True, slots=True)
class ObjectTable(Table):
    """The objects that a tracker received at one key frame, world frame."""

    COLUMNS: ClassVar[Columns] = {
        "label": Column(np.str_),
        "centre_m": Column(np.float64, (3,)),
        "size_m": Column(np.float64, (3,)),
        "yaw_rad": Column(np.float64),
        "score": Column(np.float64),
        "velocity_mps": Column(np.float64, (2,)),
    }
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset({"velocity_mps"})

    label: Texts
    centre_m: F64
    size_m: F64
    yaw_rad: F64
    score: F64
    velocity_mps: F64
    """(D, 2) measured velocity over the ground; NaN where none was measured."""

    @classmethod
    def of(cls, objects: Objects) -> ObjectTable:
        """Make the table of objects in the world frame."""
        velocity_mps = np.full((len(objects), 2), np.nan)
        if objects.velocity is not None:
            measured = objects.velocity.valid
            velocity_mps[measured] = objects.velocity.mean_mps[measured]
        boxes = {name: getattr(objects, name) for name in cls.COLUMNS if name != "velocity_mps"}
        return cls(**boxes, velocity_mps=velocity_mps)


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Points and flow (ego frame) and objects (world frame) of one key frame."""

    frame: int
    """Row of the scene's FrameTable."""
    xyz_m: F32
    """(N, 3) points of the sweep, thinned; empty where no part reads sweeps."""
    grid: BevGrid
    cells: I64
    """(K, 2) row and column of the occupied cells."""
    velocity_mps: F32
    """(K, 2) their estimated velocity, ego axes."""
    valid: Mask
    """(K,) whether the source measured it."""
    objects: ObjectTable
    """The objects that the tracker received."""

    @classmethod
    def of(
        cls, frame: int, xyz_m: F32, field: FlowField | None, objects: Objects | None
    ) -> Snapshot:
        """Keep these points, the occupied cells of a field and the objects (world frame)."""
        field = FlowField.empty(BevGrid(), 0) if field is None else field
        return cls(
            frame=frame,
            xyz_m=xyz_m,
            grid=field.grid,
            cells=np.argwhere(field.occupied),
            velocity_mps=field.velocity_mps[field.occupied],
            valid=field.valid[field.occupied],
            objects=ObjectTable.empty() if objects is None else ObjectTable.of(objects),
        )

    @property
    def xy_m(self) -> F64:
        """(K, 2) centres of the occupied cells in metres."""
        return self.grid.centres_m()[self.cells[:, 0], self.cells[:, 1]]


def save_snapshots(path: Path, snapshots: Sequence[Snapshot]) -> None:
    """Store the snapshots of one scene, at least one, atomically."""
    grids = [s.grid for s in snapshots]
    objects = ObjectTable.stacked([s.objects for s in snapshots])
    arrays: dict[str, NDArray[Any]] = {
        "frame": np.array([s.frame for s in snapshots]),
        "grid": np.array([(g.x_min_m, g.x_max_m, g.y_min_m, g.y_max_m, g.cell_m) for g in grids]),
        "counts": np.array([(len(s.xyz_m), len(s.cells), len(s.objects)) for s in snapshots]),
        "xyz_cm": _steps(np.concatenate([s.xyz_m for s in snapshots])),
        "cells": np.concatenate([s.cells for s in snapshots]).astype(np.uint16),
        "flow_cmps": _steps(np.concatenate([s.velocity_mps for s in snapshots])),
        "valid": np.concatenate([s.valid for s in snapshots]),
    }
    for name in ObjectTable.COLUMNS:
        column = getattr(objects, name)
        whole = name in ("label", "centre_m")
        arrays[f"objects.{name}"] = column if whole else column.astype(np.float32)
    write_arrays(path, arrays, FORMAT)


def load_snapshots(path: Path) -> list[Snapshot]:
    """Read what ``save_snapshots`` wrote, in order of time.

    Raises:
        ResultError: the file is missing, damaged, or of another version.
    """
    arrays = read_arrays(path, FORMAT)
    ends = np.cumsum(arrays["counts"], axis=0)[:-1].T
    points = np.split(STEP * arrays["xyz_cm"].astype(np.float32), ends[0])
    cells = np.split(arrays["cells"].astype(np.int64), ends[1])
    flow = np.split(STEP * arrays["flow_cmps"].astype(np.float32), ends[1])
    valid = np.split(arrays["valid"], ends[1])
    columns = {n: np.split(arrays[f"objects.{n}"], ends[2]) for n in ObjectTable.COLUMNS}
    return [
        Snapshot(
            frame=int(arrays["frame"][t]),
            xyz_m=points[t],
            grid=BevGrid(*(float(x) for x in arrays["grid"][t])),
            cells=cells[t],
            velocity_mps=flow[t],
            valid=valid[t],
            objects=ObjectTable(**{name: column[t] for name, column in columns.items()}),
        )
        for t in range(len(arrays["frame"]))
    ]


def _steps(values: Floats) -> I16:
    """Quantise to whole steps; clip to what 16 bits hold (327 m, 327 m/s)."""
    limit = np.iinfo(np.int16).max
    return np.asarray(np.clip(np.rint(values / STEP), -limit, limit), np.int16)
