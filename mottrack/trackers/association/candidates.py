"""Candidate pairs within reach of each other, found without comparing every pair."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64

ROUNDING = 1e-9
"""Relative margin of the binary search, so that the exact comparison decides at the very edge."""


class _Sorted(NamedTuple):
    """Rows in the order of their groups, within a group along x."""

    row: I64
    """(N,) of the positions."""
    start: I64
    """(G + 1,) first entry of each group, and the end."""


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
        groups: group of each row of both sides, (N,) and (M,), numbered from 0 on; only members of
            one group pair.
    """
    n, m = len(left_xy_m), len(right_xy_m)
    if n == 0 or m == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    reach = np.empty((m, 2))
    reach[:] = np.reshape(reach_m, (m, -1))
    group, wanted = groups or (np.zeros(n, np.int64), np.zeros(m, np.int64))
    # compiled for contiguous arrays alone
    places = np.ascontiguousarray(left_xy_m), np.ascontiguousarray(right_xy_m)
    return _near(*places, reach, group, wanted)


@compiled
def _near(left: F64, right: F64, reach: F64, group: I64, wanted: I64) -> tuple[I64, I64]:
    """Search the strip of each right row twice: to count the pairs per left row, to list them."""
    ordered = _sorted(left, group, max(group.max(), wanted.max()) + 1)
    x = left[:, 0][ordered.row]
    position = np.zeros(len(left) + 1, np.int64)
    rows, columns = np.empty(0, np.int64), np.empty(0, np.int64)
    for listing in (False, True):
        if listing:
            position = np.cumsum(position)
            rows, columns = np.empty(position[-1], np.int64), np.empty(position[-1], np.int64)
        for j in range(len(right)):
            x_j, y_j, reach_x, reach_y = right[j, 0], right[j, 1], reach[j, 0], reach[j, 1]
            stop = ordered.start[wanted[j] + 1]
            for k in range(_strip_start(x, ordered.start[wanted[j]], stop, x_j - reach_x), stop):
                if x[k] - x_j > reach_x:
                    break
                i = ordered.row[k]
                if not (abs(x[k] - x_j) <= reach_x and abs(left[i, 1] - y_j) <= reach_y):
                    continue
                if listing:
                    rows[position[i]], columns[position[i]] = i, j
                    position[i] += 1
                else:
                    position[i + 1] += 1
    return rows, columns


@compiled
def _sorted(xy: F64, group: I64, groups: int) -> _Sorted:
    by_x = np.argsort(xy[:, 0], kind="mergesort")
    start = np.zeros(groups + 1, np.int64)
    for n in range(len(group)):
        start[group[n] + 1] += 1
    start = np.cumsum(start)
    place, row = start.copy(), np.empty(len(group), np.int64)
    for n in by_x:
        row[place[group[n]]] = n
        place[group[n]] += 1
    return _Sorted(row, start)


@compiled
def _strip_start(sorted_x: F64, start: int, stop: int, x: float) -> int:
    """Return the first row in start..stop, sorted along x, that is not clearly below x."""
    x -= ROUNDING * (1.0 + abs(x))
    while start < stop:
        middle = (start + stop) // 2
        if sorted_x[middle] < x:
            start = middle + 1
        else:
            stop = middle
    return start
