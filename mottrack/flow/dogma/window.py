"""The part of the world's lattice of cells that the filter covers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64
from mottrack.lidar.scrolling import kept_slices


class CellBounds(NamedTuple):
    """First and one past the last row and column."""

    row_start: int
    row_stop: int
    col_start: int
    col_stop: int


class Window(NamedTuple):
    """A rectangle of the world-aligned lattice; cell (r, c) is lattice cell (row0 + r, col0 + c).

    It follows the vehicle by whole cells and never rotates: a static cell stays the same cell, and
    particles are never resampled in space.
    """

    row0: int
    """Lattice row (world y) of the first row."""
    col0: int
    """Lattice column (world x) of the first column."""
    rows: int
    cols: int
    cell_m: float

    @classmethod
    def around(cls, x_m: float, y_m: float, cells: int, cell_m: float) -> Window:
        """Return a square of `cells` x `cells` with the world position in its middle."""
        row0 = int(np.floor(y_m / cell_m)) - cells // 2
        col0 = int(np.floor(x_m / cell_m)) - cells // 2
        return cls(row0, col0, cells, cells, cell_m)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.rows, self.cols

    @property
    def corner_m(self) -> F64:
        """(2,) world x and y of the window's lower corner."""
        return np.array([self.col0 * self.cell_m, self.row0 * self.cell_m])

    def offset_to(self, other: Window) -> tuple[int, int]:
        """Return the rows and columns from this window to `other`."""
        return other.row0 - self.row0, other.col0 - self.col0

    def kept_from(self, before: Window) -> CellBounds:
        """Return the rows and columns that were in the window before, too."""
        rows, _ = kept_slices(self.rows, self.row0 - before.row0)
        cols, _ = kept_slices(self.cols, self.col0 - before.col0)
        return CellBounds(rows.start, rows.stop, cols.start, cols.stop)
