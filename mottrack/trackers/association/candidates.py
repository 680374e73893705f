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
    i, j = _strip_pairs(*_apart(left_xy_m[:, 0], right_xy_m[:, 0], reach[:, 0], groups))
    if groups is not None:
        same = groups[0][i] == groups[1][j]
        i, j = i[same], j[same]
    near = np.all(np.abs(left_xy_m[i] - right_xy_m[j]) <= reach[j], axis=1)
    i, j = i[near], j[near]
    order = np.lexsort((j, i))
    return i[order], j[order]


def _apart(
    left_m: F64, right_m: F64, reach_m: F64, groups: tuple[I64, I64] | None
) -> tuple[F64, F64, F64]:
    """Positions along x with the groups set side by side, so that one sweep serves them all."""
    if groups is None:
        return left_m, right_m, reach_m
    low = min(float(left_m.min()), float(right_m.min()))
    extent = max(float(left_m.max()), float(right_m.max())) - low + 1.0
    reach = np.minimum(reach_m, extent)
    pitch = extent + float(reach.max())
    slack = reach + 1e-9 * pitch * (1.0 + float(np.max(groups[1])))
    return left_m - low + pitch * groups[0], right_m - low + pitch * groups[1], slack


def runs(rows: I64) -> list[tuple[int, int]]:
    """Bounds (start, stop) of the runs of equal values in the sorted `rows` (P,)."""
    starts = np.flatnonzero(np.diff(rows, prepend=-1)).tolist()
    return list(zip(starts, [*starts[1:], len(rows)], strict=False))


def _strip_pairs(left_m: F64, right_m: F64, reach_m: F64) -> tuple[I64, I64]:
    """Pairs no further apart than reach_m (M,) along one axis, by binary search."""
    order = np.argsort(left_m, kind="stable")
    sorted_m = left_m[order]
    first = np.searchsorted(sorted_m, right_m - reach_m, side="left")
    count = np.searchsorted(sorted_m, right_m + reach_m, side="right") - first
    column = np.repeat(np.arange(len(right_m)), count)
    offset = np.arange(len(column)) - np.repeat(np.cumsum(count) - count, count)
    return order[first[column] + offset], column
