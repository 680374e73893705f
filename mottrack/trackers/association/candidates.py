"""Which pairs can match at all, found without looking at every pair."""

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


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
    if len(left_xy_m) == 0 or len(right_xy_m) == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    reach = np.broadcast_to(np.reshape(reach_m, (len(right_xy_m), -1)), (len(right_xy_m), 2))
    groups = groups or (np.zeros(len(left_xy_m), np.int64), np.zeros(len(right_xy_m), np.int64))
    found = [
        _strip_pairs(
            left_xy_m,
            right_xy_m,
            reach,
            np.flatnonzero(groups[0] == g),
            np.flatnonzero(groups[1] == g),
        )
        for g in np.intersect1d(groups[0], groups[1])
    ]
    if not found:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    left = np.concatenate([pair[0] for pair in found])
    right = np.concatenate([pair[1] for pair in found])
    order = np.lexsort((right, left))
    return left[order], right[order]


def runs(rows: I64) -> list[tuple[int, int]]:
    """Bounds (start, stop) of the runs of equal values in the sorted `rows` (P,)."""
    starts = np.flatnonzero(np.diff(rows, prepend=-1)).tolist()
    return list(zip(starts, [*starts[1:], len(rows)], strict=False))


def _strip_pairs(
    left_xy_m: F64, right_xy_m: F64, reach_m: F64, left: I64, right: I64
) -> tuple[I64, I64]:
    left = left[np.argsort(left_xy_m[left, 0], kind="stable")]
    x_sorted = left_xy_m[left, 0]
    x, reach = right_xy_m[right, 0], reach_m[right, 0]
    first = np.searchsorted(x_sorted, x - reach, side="left")
    count = np.searchsorted(x_sorted, x + reach, side="right") - first
    column = np.repeat(np.arange(len(right)), count)
    offset = np.arange(len(column)) - np.repeat(np.cumsum(count) - count, count)
    i, j = left[first[column] + offset], right[column]
    near = np.abs(left_xy_m[i, 1] - right_xy_m[j, 1]) <= reach_m[j, 1]
    return i[near], j[near]
