"""What joins the records of nuScenes tables: `prev` and `next`, times, poses."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.formats.checks import check_rotations, check_world_places
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import MissingError

LINKS = (ColumnSpec("prev", str), ColumnSpec("next", str))
LATEST_US = np.iinfo(np.int64).max // 1000
"""The last microsecond that nanoseconds of 64 bits can hold."""


def check_links(table: Columns, group: I64) -> None:
    """Raise `DataError` unless `prev` and `next` of each record are its neighbours.

    A record that was lost is found by the links of those beside it. Tables without any link are
    taken: some tools leave all of them empty.

    Args:
        table: records with `token`, `prev` and `next`, sorted by group and time.
        group: (N,) ascending number of the chain that each record belongs to.
    """
    token, before, after = table["token"], table["prev"], table["next"]
    if not len(table) or not ((before != b"") | (after != b"")).any():
        return
    same = group[1:] == group[:-1]
    follower = np.append(np.where(same, token[1:], b""), b"")
    leader = np.insert(np.where(same, token[:-1], b""), 0, b"")
    expected = "the record that {} in its chain, or empty at its end (is a record missing?)"
    table.refuse("next", after != follower, expected.format("follows"), MissingError)
    table.refuse("prev", before != leader, expected.format("precedes"), MissingError)


def check_stamps(table: Columns, name: str) -> None:
    """Raise `DataError` for a time in microseconds that nanoseconds of 64 bits can't hold."""
    outside = (table[name] < 0) | (table[name] > LATEST_US)
    table.refuse(name, outside, f"microseconds, 0 to {LATEST_US}")


def checked_poses(table: Columns) -> F64:
    """Return rotation and translation side by side, (N, 7), each a rotation and on Earth."""
    check_rotations(table)
    check_world_places(table)
    return np.hstack([table["rotation"], table["translation"]])
