"""Which pairs can match at all, found without looking at every pair."""

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64

ROUNDING = 1e-9
"""The strips begin a little early, so that the exact comparison decides at the very edge."""


def candidate_pairs(
    left_xy_m: F64,
    right_xy_m: F64,
    reach_m: F64,
    groups: tuple[I64, I64] | None = None,
) -> tuple[I64, I64]:
    """Pairs (i, j) with |dx| and |dy| at most `reach_m[j]`, sorted by i, then j.

    left_xy_m (N, 2) and right_xy_m (M, 2) are positions in metres, reach_m (M,) or (M, 2) the
    largest offset along x and y, `groups` the group of each row of both sides: only members of
    one group are paired. A strip along x is cut out by binary search, so the work grows with the
    number of neighbours, not with N times M. The box is inclusive: the exact gate comes after.
    """
    n, m = len(left_xy_m), len(right_xy_m)
    if n == 0 or m == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    reach = np.empty((m, 2))
    reach[:] = np.reshape(reach_m, (m, -1))
    group, wanted = groups or (np.zeros(n, np.int64), np.zeros(m, np.int64))
    order = np.lexsort((left_xy_m[:, 0], group))
    block = [np.searchsorted(group[order], wanted, side) for side in ("left", "right")]
    ordered = (left_xy_m[order], order)
    return _near(ordered, np.ascontiguousarray(right_xy_m), reach, (block[0], block[1]))


def runs(rows: I64) -> list[tuple[int, int]]:
    """Bounds (start, stop) of the runs of equal values in the sorted `rows` (P,)."""
    starts = np.flatnonzero(np.diff(rows, prepend=-1)).tolist()
    return list(zip(starts, [*starts[1:], len(rows)], strict=False))


@compiled
def _near(left: tuple[F64, I64], right: F64, reach: F64, block: tuple[I64, I64]) -> tuple[I64, I64]:
    """Walks the strip of each right row twice: to count the pairs of each left row, to list them.

    `left` are positions sorted along x within each group, and the rows they were before; `block`
    is where each right row's group begins and ends there.
    """
    place = np.zeros(len(left[0]) + 1, np.int64)
    rows, columns = np.empty(0, np.int64), np.empty(0, np.int64)
    for listing in (False, True):
        if listing:
            place = np.cumsum(place)
            rows, columns = np.empty(place[-1], np.int64), np.empty(place[-1], np.int64)
        for j in range(len(right)):
            start, stop = block[0][j], block[1][j]
            for k in range(_strip_start(left[0], start, stop, right[j, 0] - reach[j, 0]), stop):
                if left[0][k, 0] - right[j, 0] > reach[j, 0]:
                    break
                if not _inside(left[0][k], right[j], reach[j]):
                    continue
                i = left[1][k]
                if listing:
                    rows[place[i]], columns[place[i]] = i, j
                    place[i] += 1
                else:
                    place[i + 1] += 1
    return rows, columns


@compiled
def _strip_start(xy: F64, start: int, stop: int, x: float) -> int:
    """First of the rows from start up to stop, sorted along x, that is not well below x."""
    x -= ROUNDING * (1.0 + abs(x))
    while start < stop:
        middle = (start + stop) // 2
        if xy[middle, 0] < x:
            start = middle + 1
        else:
            stop = middle
    return start


@compiled
def _inside(a: F64, b: F64, reach: F64) -> bool:
    return bool(abs(a[0] - b[0]) <= reach[0] and abs(a[1] - b[1]) <= reach[1])
