"""Windows of all tracks as arrays: a ring buffer of nodes per slot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.trackers.fixed_lag.nodes import NODE_FIELDS, NodeBatch

Layout = Mapping[str, tuple[Any, tuple[int, ...]]]
"""Type and shape of each stored field of a node, by name."""

_OWN: Layout = {"stamp_ns": (np.int64, ()), "dt_s": (np.float64, ())}


class NodeStore:
    """The nodes of every track's window, with the fields that an engine adds.

    `store["name"]` is an array (S, K, ...) with a row per slot and a column per node; the columns
    of a slot are a ring buffer. Rows and columns are added as they are needed.
    """

    def __init__(self, extra: Layout) -> None:
        self._layout = {**_OWN, **NODE_FIELDS, **extra}
        # columns at the start; doubled when a window needs more
        self._arrays = self._fresh(0, 8)
        self._first = np.zeros(0, np.int64)
        self.count = np.zeros(0, np.int64)
        """(S,) nodes in each window; 0 for a free slot."""

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._arrays[name]

    def _fresh(self, slots: int, nodes: int) -> dict[str, NDArray[Any]]:
        return {n: np.zeros((slots, nodes, *tail), t) for n, (t, tail) in self._layout.items()}

    @property
    def _nodes(self) -> int:
        return int(self["stamp_ns"].shape[1])

    def live(self, slots: I64) -> Mask:
        """Return whether each slot (N,) has a window."""
        known = slots < len(self.count)
        known[known] = self.count[slots[known]] > 0
        return known

    def reserve(self, slots: I64) -> None:
        """Make room for one more node in each of these slots (N,)."""
        have, nodes = len(self.count), self._nodes
        rows = max(int(slots.max(initial=-1)) + 1, have)
        full = len(slots) > 0 and rows == have and int(self.count[slots].max()) >= nodes
        if rows == have and not full:
            return
        rows = rows if rows == have else max(rows, 2 * have)
        arrays = self._fresh(rows, 2 * nodes if full else nodes)
        order = (self._first[:, None] + np.arange(nodes)) % nodes
        for name, array in self._arrays.items():
            arrays[name][:have, :nodes] = array[np.arange(have)[:, None], order]
        self._arrays = arrays
        self._first = np.zeros(rows, np.int64)
        self.count = np.concatenate([self.count, np.zeros(rows - have, np.int64)])
        self.reserve(slots)

    def at(self, slots: I64, number: I64 | int) -> I64:
        """Return the column of node `number` of each slot's window, 0 for the oldest."""
        return (self._first[slots] + number) % self._nodes

    def before(self, column: I64) -> I64:
        """Return the column before each of these."""
        return (column - 1) % self._nodes

    def append(self, batch: NodeBatch, dt_s: F64) -> None:
        """Add a node to each slot of a batch, for which there is room."""
        column = self.at(batch.slot, self.count[batch.slot])
        for name in NODE_FIELDS:
            self[name][batch.slot, column] = getattr(batch, name)
        self["stamp_ns"][batch.slot, column] = batch.stamp_ns
        self["dt_s"][batch.slot, column] = dt_s
        self.count[batch.slot] += 1

    def drop_before(self, slots: I64, oldest_ns: int) -> None:
        """Remove nodes older than `oldest_ns` from windows that have newer ones."""
        while len(slots):
            old = self["stamp_ns"][slots, self.at(slots, 0)] < oldest_ns
            slots = slots[old]
            self._first[slots] = (self._first[slots] + 1) % self._nodes
            self.count[slots] -= 1

    def clear(self, slot: int) -> None:
        """Free a slot."""
        self.count[slot] = 0

    def fields(self, slots: I64, columns: I64) -> dict[str, Any]:
        """Return the fields of `NodeBatch` at these nodes (N,), by name."""
        return {name: self[name][slots, columns] for name in NODE_FIELDS}

    def rows(self, slots: I64) -> dict[str, NDArray[Any]]:
        """Return copies of all fields of these slots (N,)."""
        return {name: array[slots] for name, array in self._arrays.items()}

    def restore(self, slots: I64, rows: Mapping[str, NDArray[Any]]) -> None:
        """Put such copies back."""
        for name, array in self._arrays.items():
            array[slots] = rows[name]
