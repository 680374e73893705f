"""The bird's-eye-view grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Floats, Mask
from mottrack.core.errors import InputError

WHOLE_CELLS = 1e-6
"""Rounding of (extent / cell side) in float64, in cells: 400.0000001 cells are 400."""


class CellIndex(NamedTuple):
    """Cells that N positions fall into."""

    row: I64
    """(N,) clipped to the grid."""
    column: I64
    """(N,) clipped to the grid."""
    inside: Mask
    """(N,) whether the position lies inside the grid."""


@dataclass(frozen=True, slots=True)
class BevGrid:
    """A grid over the ground plane of the ego frame; (H, W) = (rows along y, columns along x).

    Row and column grow with y and x, so ``imshow(..., origin="lower")`` shows x to the right and
    y up. The default is the paper's: [-50, 50] m at 0.25 m, 400 x 400 cells (section IV-B).

    Raises:
        InputError: an extent is empty or not a whole number of cells.
    """

    x_min_m: float = -50.0
    x_max_m: float = 50.0
    y_min_m: float = -50.0
    y_max_m: float = 50.0
    cell_m: float = 0.25

    def __post_init__(self) -> None:
        values = (self.x_min_m, self.x_max_m, self.y_min_m, self.y_max_m, self.cell_m)
        if not np.isfinite(values).all():
            raise InputError("grid", values, "finite numbers")
        if not self.cell_m > 0:
            raise InputError("cell_m", self.cell_m, "a positive number of metres")
        for axis, low, high in (
            ("x", self.x_min_m, self.x_max_m),
            ("y", self.y_min_m, self.y_max_m),
        ):
            cells = (high - low) / self.cell_m
            if not (cells >= 1 and abs(cells - round(cells)) < WHOLE_CELLS):
                raise InputError(
                    f"{axis} extent", [low, high], f"a whole number of cells of {self.cell_m} m"
                )

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W): number of rows (y) and columns (x)."""
        height = round((self.y_max_m - self.y_min_m) / self.cell_m)
        width = round((self.x_max_m - self.x_min_m) / self.cell_m)
        return height, width

    @property
    def reach_m(self) -> float:
        """Distance from the vehicle to the farthest side, in metres."""
        return max(abs(self.x_min_m), abs(self.x_max_m), abs(self.y_min_m), abs(self.y_max_m))

    def cells(self, xy_m: Floats) -> CellIndex:
        """Return the cells of (N, 2) or (N, 3) positions in metres, ego frame."""
        height, width = self.shape
        column = np.floor((xy_m[:, 0] - self.x_min_m) / self.cell_m)
        row = np.floor((xy_m[:, 1] - self.y_min_m) / self.cell_m)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        return CellIndex(
            np.clip(row, 0, height - 1).astype(np.int64),
            np.clip(column, 0, width - 1).astype(np.int64),
            inside,
        )

    def centres_m(self) -> F64:
        """Return (H, W, 2) x and y of the centre of every cell, in metres, ego frame."""
        height, width = self.shape
        x = self.x_min_m + (np.arange(width) + 0.5) * self.cell_m
        y = self.y_min_m + (np.arange(height) + 0.5) * self.cell_m
        return np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)

    def counts(self, xy_m: Floats) -> I64:
        """Return the number (H, W) of positions in each cell."""
        height, width = self.shape
        row, column, inside = self.cells(xy_m)
        flat = (row * width + column)[inside]
        return np.bincount(flat, minlength=height * width).reshape(height, width)

    def occupancy(self, xy_m: Floats) -> Mask:
        """Return (H, W) whether a cell holds at least one position."""
        return self.counts(xy_m) > 0
