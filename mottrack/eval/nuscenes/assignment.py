"""Rectangular assignment by shortest augmenting paths (Crouse, 2016), compiled.

The official evaluation solves its frames with SciPy's solver. Where several assignments cost the
same, the answer depends on the order in which columns are looked at, so this solver keeps to
SciPy's: the columns still open are kept in a list, last column first, a settled one is replaced by
the list's end, and among equal columns a free one is preferred.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

ROW = np.dtype([("price", "f8"), ("column", "i8"), ("seen", "i8")])
COLUMN = np.dtype(
    [("price", "f8"), ("row", "i8"), ("seen", "i8"), ("way", "f8"), ("path", "i8"), ("open", "i8")]
)


class Solver(NamedTuple):
    """Working memory for matrices of up to K rows and columns."""

    cost: NDArray[np.float64]
    """(K, K) the smaller side along the rows."""
    row: NDArray[Any]
    """(K,) of ROW: price, assigned column, seen on the present path."""
    column: NDArray[Any]
    """(K,) of COLUMN: price, assigned row (-1: free), seen, cheapest way to it and its last row;
    `open` is the list of columns still open."""


def make_solver(size: int) -> Solver:
    """Memory for matrices of up to `size` rows and columns."""
    return Solver(np.empty((size, size)), np.zeros(size, ROW), np.zeros(size, COLUMN))


@numba.njit(cache=True)
def solve(s: Solver, rows: int, columns: int) -> None:
    """Assigns every row of `s.cost[:rows, :columns]` (rows <= columns) a column.

    The answer is left in `s.row[i].column`.
    """
    for i in range(rows):
        s.row[i].price = 0.0
        s.row[i].column = -1
    for j in range(columns):
        s.column[j].price = 0.0
        s.column[j].row = -1
    for start in range(rows):
        sink, length = _shortest_path(s, start, rows, columns)
        for i in range(rows):
            if i == start:
                s.row[i].price += length
            elif s.row[i].seen:
                s.row[i].price += length - s.column[s.row[i].column].way
        for j in range(columns):
            if s.column[j].seen:
                s.column[j].price -= length - s.column[j].way
        at = -1
        while at != start:
            at = s.column[sink].path
            s.column[sink].row = at
            displaced = s.row[at].column
            s.row[at].column = sink
            sink = displaced


@numba.njit(cache=True)
def _shortest_path(s: Solver, start: int, rows: int, columns: int) -> tuple[int, float]:
    """The free column that is cheapest to reach from the row, and the length of the way."""
    for i in range(rows):
        s.row[i].seen = 0
    for j in range(columns):
        s.column[j].seen = 0
        s.column[j].way = np.inf
        s.column[j].open = columns - 1 - j
    length = 0.0
    i = start
    left = columns
    while True:
        s.row[i].seen = 1
        lowest = np.inf
        best = 0
        for k in range(left):
            j = s.column[k].open
            way = length + s.cost[i, j] - s.row[i].price - s.column[j].price
            if way < s.column[j].way:
                s.column[j].path = i
                s.column[j].way = way
            free = s.column[j].row == -1
            if s.column[j].way < lowest or (free and s.column[j].way == lowest):
                lowest = s.column[j].way
                best = k
        length = lowest
        j = s.column[best].open
        s.column[j].seen = 1
        i = s.column[j].row
        if i == -1:
            return j, length
        left -= 1
        s.column[best].open = s.column[left].open
