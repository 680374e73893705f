"""The part of the world's lattice of cells that the filter looks at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F32, F64


class Window(NamedTuple):
    """A rectangle of the world-aligned lattice; cell (r, c) is lattice cell (row0 + r, col0 + c).

    A named tuple, so that numba takes it as one argument. It follows the vehicle by whole cells
    and never turns: a static cell stays the same cell, and particles are never resampled in space.
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
        """A square of `cells` x `cells` with the world position in one of its middle cells."""
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
        """(rows, columns) by which `other` lies further along."""
        return other.row0 - self.row0, other.col0 - self.col0

    def kept_from(self, before: Window) -> tuple[int, int, int, int]:
        """First and one past the last row and column that were in the window before, too."""
        rows, _ = _overlap(self.rows, self.row0 - before.row0)
        cols, _ = _overlap(self.cols, self.col0 - before.col0)
        return rows.start, rows.stop, cols.start, cols.stop


def moved(values: F32, offset: tuple[int, int]) -> F32:
    """Values (rows, cols) of the same cells after the window moved by `offset`; new cells are 0."""
    result = np.zeros_like(values)
    row_to, row_from = _overlap(values.shape[0], offset[0])
    col_to, col_from = _overlap(values.shape[1], offset[1])
    result[row_to, col_to] = values[row_from, col_from]
    return result


def _overlap(length: int, offset: int) -> tuple[slice, slice]:
    """Where the kept cells of an axis lie after and before a move by `offset`."""
    kept = max(length - abs(offset), 0)
    after, before = max(-offset, 0), max(offset, 0)
    return slice(after, after + kept), slice(before, before + kept)
