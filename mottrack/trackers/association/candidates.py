"""Candidate pairs within reach of each other, found without comparing every pair."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64

ROUNDING = 1e-9
"""Relative margin of the binary search, so that the exact comparison decides at the very edge."""


class _Sorted(NamedTuple):
    """Left positions sorted by group and then along x, and where to search each right row."""

    xy_m: F64
    """(N, 2)"""
    row: I64
    """(N,) the row that each had before sorting."""
    start: I64
    """(M,) first entry of the group of each right row."""
    stop: I64
    """(M,) end of that group."""


def candidate_pairs(
    left_xy_m: F64,
    right_xy_m: F64,
    reach_m: F64,
    groups: tuple[I64, I64] | None = None,
) -> tuple[I64, I64]:
    """Return the pairs (i, j) with |dx| and |dy| at most `reach_m[j]`, sorted by i, then j.

    A strip along x is cut out by binary search, so the work grows with the number of neighbours,
    not with N times M. The bounds are inclusive: an exact gate may follow.

    Args:
        left_xy_m: positions (N, 2) in metres.
        right_xy_m: positions (M, 2) in metres, same frame.
        reach_m: largest offset (M,), or (M, 2) along x and y.
        groups: group of each row of both sides, (N,) and (M,); only members of one group pair.
    """
    n, m = len(left_xy_m), len(right_xy_m)
    if n == 0 or m == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    reach = np.empty((m, 2))
    reach[:] = np.reshape(reach_m, (m, -1))
    group, wanted = groups or (np.zeros(n, np.int64), np.zeros(m, np.int64))
    order = np.lexsort((left_xy_m[:, 0], group))
    start, stop = (np.searchsorted(group[order], wanted, side) for side in ("left", "right"))
    return _near(
        _Sorted(left_xy_m[order], order, start, stop), np.ascontiguousarray(right_xy_m), reach
    )


@compiled
def _near(left: _Sorted, right: F64, reach: F64) -> tuple[I64, I64]:
    """Search the strip of each right row twice: to count the pairs per left row, to list them."""
    xy, order = left.xy_m, left.row
    position = np.zeros(len(xy) + 1, np.int64)
    rows, columns = np.empty(0, np.int64), np.empty(0, np.int64)
    for listing in (False, True):
        if listing:
            position = np.cumsum(position)
            rows, columns = np.empty(position[-1], np.int64), np.empty(position[-1], np.int64)
        for j in range(len(right)):
            stop = left.stop[j]
            for k in range(_strip_start(xy, left.start[j], stop, right[j, 0] - reach[j, 0]), stop):
                if xy[k, 0] - right[j, 0] > reach[j, 0]:
                    break
                near_x = abs(xy[k, 0] - right[j, 0]) <= reach[j, 0]
                if not (near_x and abs(xy[k, 1] - right[j, 1]) <= reach[j, 1]):
                    continue
                i = order[k]
                if listing:
                    rows[position[i]], columns[position[i]] = i, j
                    position[i] += 1
                else:
                    position[i + 1] += 1
    return rows, columns


@compiled
def _strip_start(xy: F64, start: int, stop: int, x: float) -> int:
    """Return the first row in start..stop, sorted along x, that is not clearly below x."""
    x -= ROUNDING * (1.0 + abs(x))
    while start < stop:
        middle = (start + stop) // 2
        if xy[middle, 0] < x:
            start = middle + 1
        else:
            stop = middle
    return start
