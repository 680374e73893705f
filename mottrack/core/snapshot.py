"""Points and flow of a few frames, kept for pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import ResultError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.core.sweep import Sweep

COLUMNS = ("frame", "xyz_m", "grid", "cells", "velocity_mps", "valid")


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What one key frame looked like, in its ego frame."""

    frame: int
    """Row of the scene's FrameTable."""
    xyz_m: NDArray[np.float32]
    """(N, 3) points of the sweep."""
    grid: BevGrid
    cells: NDArray[np.int64]
    """(K, 2) row and column of the occupied cells."""
    velocity_mps: NDArray[np.float32]
    """(K, 2) their estimated velocity, ego axes."""
    valid: NDArray[np.bool_]
    """(K,) whether the source measured it."""

    @classmethod
    def of(cls, frame: int, sweep: Sweep, field: FlowField | None) -> Snapshot:
        """Takes a frame's points and, where there is a field, its occupied cells."""
        if field is None:
            field = FlowField.empty(BevGrid(), sweep.stamp_ns)
        rows, columns = np.nonzero(field.occupied)
        return cls(
            frame=frame,
            xyz_m=sweep.xyz_m,
            grid=field.grid,
            cells=np.column_stack([rows, columns]),
            velocity_mps=field.velocity_mps[rows, columns],
            valid=field.valid[rows, columns],
        )

    @property
    def xy_m(self) -> NDArray[np.float64]:
        """(K, 2) centres of the occupied cells in metres."""
        centres: NDArray[np.float64] = self.grid.centres_m()[self.cells[:, 0], self.cells[:, 1]]
        return centres


def save_snapshots(path: Path, snapshots: list[Snapshot]) -> None:
    """Stores snapshots of one scene, replaced at once or not at all."""
    arrays = {"count": np.array(len(snapshots))}
    for index, s in enumerate(snapshots):
        grid = (s.grid.x_min_m, s.grid.x_max_m, s.grid.y_min_m, s.grid.y_max_m, s.grid.cell_m)
        values = (s.frame, s.xyz_m, grid, s.cells, s.velocity_mps, s.valid)
        for name, value in zip(COLUMNS, values, strict=True):
            arrays[f"{index}.{name}"] = np.asarray(value)
    write_arrays(path, arrays)


def load_snapshots(path: Path) -> list[Snapshot]:
    """Reads what ``save_snapshots`` wrote.

    Raises:
        ResultError: the file is missing or damaged.
    """
    arrays = read_arrays(path)
    try:
        return [_snapshot(arrays, index) for index in range(int(arrays["count"]))]
    except KeyError as error:
        raise ResultError(path, "content", f"without {error}", "every column") from error


def _snapshot(arrays: dict[str, NDArray[Any]], index: int) -> Snapshot:
    frame, xyz_m, grid, cells, velocity_mps, valid = (arrays[f"{index}.{c}"] for c in COLUMNS)
    extent = BevGrid(*(float(x) for x in grid))
    return Snapshot(int(frame), xyz_m, extent, cells, velocity_mps, valid)
