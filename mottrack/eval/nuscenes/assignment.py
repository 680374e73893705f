"""Rectangular assignment by shortest augmenting paths (Crouse, 2016), compiled.

The official evaluation solves its frames with SciPy's solver. Where several assignments cost the
same, the answer depends on the order in which columns are looked at, so this solver keeps to
SciPy's: the columns still open are kept in a list, last column first, a closed one is replaced by
the list's end, and among equal columns a free one is preferred. Few functions, see `kernel`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, Int

ROW = np.dtype([("price", "f8"), ("column", "i8"), ("seen", "i8")])
COLUMN = np.dtype(
    [
        ("price", "f8"),
        ("row", "i8"),
        ("seen", "i8"),
        ("distance", "f8"),
        ("path", "i8"),
        ("open", "i8"),
    ]
)


class Solver(NamedTuple):
    """Working memory for matrices of up to K rows and columns."""

    cost: F64
    """(K, K) the smaller side along the rows."""
    row: NDArray[Any]
    """(K,) of ROW: dual variable (price), assigned column, visited on the present path."""
    column: NDArray[Any]
    """(K,) of COLUMN: dual variable (price), assigned row (-1: free), visited, cost of the cheapest
    path to it and the last row of that path; `open` is the list of columns still open."""


def make_solver(size: int) -> Solver:
    """Return memory for matrices of up to `size` rows and columns."""
    return Solver(np.empty((size, size)), np.zeros(size, ROW), np.zeros(size, COLUMN))


@compiled(no_cpython_wrapper=True, no_cfunc_wrapper=True)
def solve(s: Solver, rows: Int, columns: Int) -> None:  # noqa: C901
    """Assign every row of `s.cost[:rows, :columns]` (rows <= columns) a column.

    The answer is left in `s.row[i].column` and `s.column[j].row`.
    """
    for i in range(rows):
        s.row[i].price = 0.0
        s.row[i].column = -1
    for j in range(columns):
        s.column[j].price = 0.0
        s.column[j].row = -1
    for start in range(rows):
        sink = _shortest_path(s, start, rows, columns)
        length = s.column[sink].distance
        for j in range(columns):
            c = s.column[j]
            if c.seen:
                c.price -= length - c.distance
        for i in range(rows):
            r = s.row[i]
            if r.seen:
                r.price += length - (0.0 if i == start else s.column[r.column].distance)
        at = -1
        while at != start:
            at = s.column[sink].path
            s.column[sink].row = at
            displaced = s.row[at].column
            s.row[at].column = sink
            sink = displaced


@compiled(no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _shortest_path(s: Solver, start: Int, rows: Int, columns: Int) -> int:
    """Return the free column that is cheapest to reach from the row."""
    for k in range(rows):
        s.row[k].seen = 0
    for k in range(columns):
        c = s.column[k]
        c.seen = 0
        c.distance = np.inf
        c.open = columns - 1 - k
    length = 0.0
    i = start
    j = -1
    while i >= 0:
        r = s.row[i]
        r.seen = 1
        lowest = np.inf
        best = 0
        for k in range(columns):
            j = s.column[k].open
            c = s.column[j]
            reduced = length + s.cost[i, j] - r.price - c.price
            if reduced < c.distance:
                c.path = i
                c.distance = reduced
            if c.distance < lowest or (c.row < 0 and c.distance == lowest):
                lowest = c.distance
                best = k
        length = lowest
        j = s.column[best].open
        s.column[j].seen = 1
        i = s.column[j].row
        columns -= 1
        s.column[best].open = s.column[columns].open
    return j
