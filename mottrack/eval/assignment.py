"""One-to-one matching of boxes or identities by SciPy's solver, quick to import and for crowds.

A crowd is a frame of thousands of boxes of which each may match a few: the pairs that share a box
form small groups, and the groups are solved one by one. Below `DENSE` pairs the whole matrix is
solved, as the official evaluators do: where several matchings are equally good, the answer
depends on the matrix.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask

DENSE = 1_000_000
"""Boxes times boxes of a frame up to which the whole matrix is solved: 1000 of each, 8 MB. Crowds
of public data sets have up to 300."""


class Matching(NamedTuple):
    """M matched pairs."""

    row: I64
    """(M,)"""
    column: I64
    """(M,)"""


@cache
def _solver() -> Any:
    """Return `scipy.optimize.linear_sum_assignment`.

    The package imports all its optimisers, which takes longer than a small evaluation; the solver
    is one extension module that needs none of them. Where SciPy is laid out otherwise, the package
    is imported.
    """
    scipy = importlib.util.find_spec("scipy")
    for folder in scipy.submodule_search_locations or () if scipy else ():
        for suffix in importlib.machinery.EXTENSION_SUFFIXES:
            file = Path(folder) / "optimize" / f"_lsap{suffix}"
            spec = importlib.util.spec_from_file_location("_lsap", file) if file.is_file() else None
            if spec is not None and spec.loader is not None:
                module = importlib.util.module_from_spec(spec)
                spec.loader.exec_module(module)
                return module.linear_sum_assignment
    return importlib.import_module("scipy.optimize").linear_sum_assignment


def linear_sum_assignment(cost: F64, *, maximize: bool = False) -> Matching:
    """Return the one-to-one matching of rows and columns with the least total cost.

    Args:
        cost: (N, M).
        maximize: the greatest total instead.

    >>> linear_sum_assignment(np.array([[4.0, 1.0], [2.0, 0.0]])).column.tolist()
    [1, 0]
    """
    return Matching(*_solver()(cost, maximize))


def most_gain(row: I64, column: I64, gain: F64, shape: tuple[int, int]) -> I64:
    """Return which pairs are matched for the greatest total gain, one to one, ascending.

    Args:
        row: (P,) of each pair that may be matched.
        column: (P,)
        gain: (P,) positive.
        shape: number of rows and of columns.
    """
    if shape[0] * shape[1] <= DENSE:
        return _most_gain_of_matrix(np.arange(len(row)), (row, column), gain, shape)
    alone = lone_pairs(row, column)
    found = [np.flatnonzero(alone)]
    shared = np.flatnonzero(~alone)
    for group in groups(row[shared], column[shared]):
        group = Group(shared[group.pair], group.row, group.column)
        i, j, _ = group.matrix(gain, 0.0)
        places = np.searchsorted(i, group.row), np.searchsorted(j, group.column)
        size = (len(i), len(j))
        found.append(_most_gain_of_matrix(group.pair, places, gain[group.pair], size))
    return np.sort(np.concatenate(found))


def _most_gain_of_matrix(
    pair: I64, places: tuple[I64, I64], gain: F64, shape: tuple[int, int]
) -> I64:
    dense, number = np.zeros(shape), np.full(shape, -1)
    dense[places], number[places] = gain, pair
    # a row without a better partner is assigned one that it has nothing in common with
    found = number[linear_sum_assignment(dense, maximize=True)]
    return found[found >= 0]


def lone_pairs(row: I64, column: I64) -> Mask:
    """Return which pairs (P,) share neither row nor column with another one: they are matched."""
    lone: Mask = (np.bincount(row)[row] == 1) & (np.bincount(column)[column] == 1)
    return lone


class Group(NamedTuple):
    """Pairs that are linked by the rows and columns that they share."""

    pair: I64
    """Which pairs these are."""
    row: I64
    """(K,) row of each."""
    column: I64
    """(K,) column of each."""

    def matrix(self, values: F64, missing: float) -> tuple[I64, I64, F64]:
        """Return the rows (n,), the columns (m,) and the values of all pairs as (n, m)."""
        rows, i = np.unique(self.row, return_inverse=True)
        columns, j = np.unique(self.column, return_inverse=True)
        dense = np.full((len(rows), len(columns)), missing)
        dense[i, j] = values[self.pair]
        return rows, columns, dense


def groups(row: I64, column: I64) -> Iterator[Group]:
    """Yield the groups of pairs (P,) between which no row and no column is shared."""
    from scipy.sparse import coo_array  # slow to import, and needed for crowds alone
    from scipy.sparse.csgraph import connected_components

    if not len(row):
        return
    size = int(row.max()) + 1
    nodes = size + int(column.max()) + 1
    links = coo_array((np.ones(len(row), np.int8), (row, size + column)), (nodes, nodes))
    label = connected_components(links, directed=False)[1][row]
    order = np.argsort(label, kind="stable")
    for pair in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        yield Group(pair, row[pair], column[pair])
