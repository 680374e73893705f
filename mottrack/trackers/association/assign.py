"""One-to-one assignment of gated pairs; ties are broken by row, then by column."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64

Pairs = tuple[I64, I64]
Assignment = Callable[[F64, Pairs], I64]


def greedy(cost: F64, pairs: Pairs) -> I64:
    """Accept pairs in order of increasing cost while both sides are free.

    `cost` (P,) belongs to the pairs (i, j), two arrays (P,). Returns the indices of the accepted
    pairs in the order of acceptance.
    """
    if len(cost) == 0:
        return np.empty(0, np.int64)
    order = np.lexsort((pairs[1], pairs[0], cost))
    return _accept(order, (pairs[0][order], pairs[1][order]))


@compiled
def _accept(order: I64, pairs: Pairs) -> I64:
    """Return those of `order` (P,) whose pair, in the same order, has both sides still free."""
    rows, columns = pairs
    taken_left = np.zeros(rows.max() + 1, np.bool_)
    taken_right = np.zeros(columns.max() + 1, np.bool_)
    accepted = np.empty(len(order), np.int64)
    count = 0
    for k in range(len(order)):
        if not (taken_left[rows[k]] or taken_right[columns[k]]):
            taken_left[rows[k]] = taken_right[columns[k]] = True
            accepted[count] = order[k]
            count += 1
    return accepted[:count]


def hungarian(cost: F64, pairs: Pairs) -> I64:
    """Return the matching with the most pairs and, among those, the least total cost.

    Same arguments and result as `greedy`; pairs that are not listed never match. Connected
    components of the pairs are solved one by one, so the work grows with the number of conflicts.
    """
    if len(cost) == 0:
        return np.empty(0, np.int64)
    rows, i = np.unique(pairs[0], return_inverse=True)
    columns, j = np.unique(pairs[1], return_inverse=True)
    size = len(rows) + len(columns)
    links = coo_array((np.ones(len(i), np.int8), (i, len(rows) + j)), shape=(size, size))
    group = connected_components(links, directed=False)[1][i]
    isolated = np.bincount(group)[group] == 1
    chosen = [np.flatnonzero(isolated)]
    rest = np.flatnonzero(~isolated)
    order = rest[np.argsort(group[rest], kind="stable")]
    groups = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    chosen += [some[_solve(cost[some], i[some], j[some])] for some in groups]
    return np.concatenate(chosen)


def _solve(cost: F64, row: I64, column: I64) -> I64:
    """Return the indices of the pairs of the best matching within one component."""
    if len(cost) == 0:
        return np.empty(0, np.int64)
    rows, i = np.unique(row, return_inverse=True)
    columns, j = np.unique(column, return_inverse=True)
    floor = float(cost.min())
    # dearer than all listed pairs together: an absent pair is taken only where there is no other
    absent = (float(cost.max()) - floor + 1.0) * (min(len(rows), len(columns)) + 1)
    matrix = np.full((len(rows), len(columns)), absent)
    matrix[i, j] = cost - floor
    index = np.full(matrix.shape, -1, np.int64)
    index[i, j] = np.arange(len(cost))
    chosen = index[linear_sum_assignment(matrix)]
    return chosen[chosen >= 0]


def mutual_nearest(cost: F64, pairs: Pairs) -> I64:
    """Return pairs in which each side is the other's cheapest; arguments as for `greedy`."""
    order = np.lexsort((pairs[1], pairs[0], cost))
    left, right = pairs[0][order], pairs[1][order]
    first_left = np.zeros(len(order), bool)
    first_right = np.zeros(len(order), bool)
    first_left[np.unique(left, return_index=True)[1]] = True
    first_right[np.unique(right, return_index=True)[1]] = True
    return order[first_left & first_right]


ASSIGNMENTS: dict[str, Assignment] = {
    "greedy": greedy,
    "hungarian": hungarian,
    "mutual_nearest": mutual_nearest,
}
