"""Rectangular assignment by shortest augmenting paths (Crouse, 2016), compiled.

The official evaluation solves its frames with SciPy's solver. Where several assignments cost the
same, the answer depends on the order in which columns are looked at, so this solver keeps to
SciPy's: the columns still open are kept in a list, last column first, a settled one is replaced by
the list's end, and among equal columns a free one is preferred.
"""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray


class Solver(NamedTuple):
    """Working memory for matrices of up to K rows and columns."""

    cost: NDArray[np.float64]
    """(K, K) rows are the smaller side."""
    price_row: NDArray[np.float64]
    price_column: NDArray[np.float64]
    shortest: NDArray[np.float64]
    path: NDArray[np.int64]
    open_columns: NDArray[np.int64]
    column_of_row: NDArray[np.int64]
    row_of_column: NDArray[np.int64]
    row_seen: NDArray[np.bool_]
    column_seen: NDArray[np.bool_]


def make_solver(size: int) -> Solver:
    """Memory for matrices of up to `size` rows and columns."""
    floats = [np.empty(size) for _ in range(3)]
    integers = [np.empty(size, np.int64) for _ in range(4)]
    flags = [np.empty(size, np.bool_) for _ in range(2)]
    return Solver(np.empty((size, size)), *floats, *integers, *flags)


@numba.njit(cache=True)
def solve(s: Solver, rows: int, columns: int) -> None:
    """Assigns every row of `s.cost[:rows, :columns]` (rows <= columns) a column.

    The answer is left in `s.column_of_row` and `s.row_of_column` (-1 for a column left over).
    """
    s.price_row[:rows] = 0.0
    s.price_column[:columns] = 0.0
    s.column_of_row[:rows] = -1
    s.row_of_column[:columns] = -1
    for row in range(rows):
        sink, length = _shortest_path(s, row, rows, columns)
        _update_prices(s, row, length, rows, columns)
        while True:
            at = s.path[sink]
            s.row_of_column[sink] = at
            sink, s.column_of_row[at] = s.column_of_row[at], sink
            if at == row:
                break


@numba.njit(cache=True)
def _shortest_path(s: Solver, start: int, rows: int, columns: int) -> tuple[int, float]:
    """The free column that is cheapest to reach from the row, and the length of the way."""
    s.row_seen[:rows] = False
    s.column_seen[:columns] = False
    s.shortest[:columns] = np.inf
    for k in range(columns):
        s.open_columns[k] = columns - 1 - k
    length = 0.0
    row = start
    left = columns
    while True:
        s.row_seen[row] = True
        lowest = np.inf
        best = -1
        for k in range(left):
            j = s.open_columns[k]
            way = length + s.cost[row, j] - s.price_row[row] - s.price_column[j]
            if way < s.shortest[j]:
                s.path[j] = row
                s.shortest[j] = way
            free = s.row_of_column[j] == -1
            if s.shortest[j] < lowest or (free and s.shortest[j] == lowest):
                lowest = s.shortest[j]
                best = k
        length = lowest
        j = s.open_columns[best]
        s.column_seen[j] = True
        if s.row_of_column[j] == -1:
            return j, length
        row = s.row_of_column[j]
        left -= 1
        s.open_columns[best] = s.open_columns[left]


@numba.njit(cache=True)
def _update_prices(s: Solver, row: int, length: float, rows: int, columns: int) -> None:
    s.price_row[row] += length
    for i in range(rows):
        if s.row_seen[i] and i != row:
            s.price_row[i] += length - s.shortest[s.column_of_row[i]]
    for j in range(columns):
        if s.column_seen[j]:
            s.price_column[j] -= length - s.shortest[j]
