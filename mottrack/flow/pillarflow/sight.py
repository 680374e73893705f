"""What one sweep of a pair saw of the other's points, in three dimensions.

A surface that comes into view, or that is hidden, changes the picture as a motion does. So each
cell gets the share of its points that the other sweep could not see, and of those that it saw
through: the second is the mark of something that moved there, the first of something that was not
measured before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I8, I64
from mottrack.core.pose import Pose
from mottrack.flow.pillarflow.pillars import CellGrid, cell_indices
from mottrack.flow.sweep_pair import SweepPair
from mottrack.lidar.visibility import FREE, UNSEEN, queried_from, states_of

TOLERANCE_M = 0.5
"""A return this near in range is on the point; the same distance as in the registration."""
SHARES = 2
"""Channels of a sweep: hidden, passed."""


class PointSight(NamedTuple):
    """States of the obstacle points of a pair: UNSEEN, FREE or OCCUPIED in the other sweep."""

    current: I8
    """(M,) of the current points, in the previous sweep."""
    previous: I8
    """(N,) of the previous points, in the current sweep."""


def point_sight(pair: SweepPair) -> PointSight:
    """Return what each sweep saw of the other's points."""
    then = queried_from(pair.previous_features.image, pair.previous_T_current)
    now = queried_from(pair.current_features.image, Pose.identity())
    return PointSight(
        current=states_of(then, np.asarray(pair.current.xyz_m), TOLERANCE_M),
        previous=states_of(now, np.asarray(pair.previous.xyz_m), TOLERANCE_M),
    )


def sight_image(points: F32, states: I8, cells: CellGrid) -> F32:
    """Return (2,rows,columns) the shares of the points (N,4) of a cell that are hidden, passed."""
    return sight_shares(states, cell_indices(points, cells), cells.cells).reshape(
        SHARES, cells.rows, cells.columns
    )


@compiled(nogil=True)
def sight_shares(states: I8, cells: I64, count: int) -> F32:
    """Return (2,count) the shares by cell; points whose cell is negative lie on none."""
    shares = np.zeros((SHARES, count), np.float32)
    total = np.zeros(count, np.float32)
    for i in range(len(states)):
        if cells[i] < 0:
            continue
        total[cells[i]] += np.float32(1.0)
        if states[i] == UNSEEN:
            shares[0, cells[i]] += np.float32(1.0)
        elif states[i] == FREE:
            shares[1, cells[i]] += np.float32(1.0)
    for cell in range(count):
        if total[cell] > 0.0:
            shares[0, cell] /= total[cell]
            shares[1, cell] /= total[cell]
    return shares
