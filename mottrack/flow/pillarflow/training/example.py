"""One training example: a prepared pair of sweeps with the motion of every point."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mottrack.core.arrays import F32, I16, I64, U8
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.sweep import Sweep
from mottrack.flow.pillarflow.raster import (
    cell_of_centres,
    network_cells,
    network_points,
    seen_shares,
)
from mottrack.flow.sweep_pair import SweepPair

EXAMPLE_GRID = BevGrid(cell_m=0.5)
"""The visibility rasters of an example lie on this grid."""


@dataclass(frozen=True)
class Labels:
    """Truth of a pair of sweeps, for every point of the raw sweeps (not yet prepared)."""

    previous_object: I16
    """(N_previous,) row of the object that the point lies on, -1: background."""
    current_object: I16
    """(N_current,) the same for the current sweep."""
    velocity_mps: F32
    """(N_current,2) velocity over the ground of each current point, current ego axes."""
    centre_m: F32
    """(K,2,2) centre (x, y) of each object in the previous, then the current sweep; all in the
    current ego frame."""


@dataclass(frozen=True)
class Example:
    """A prepared pair, everything in the current ego frame."""

    previous: F32
    """(N,4) x, y, height above ground [m], reflectance."""
    current: F32
    """(M,4) the same of the current sweep."""
    previous_object: I16
    """(N,) row of the object, -1: background."""
    current_object: I16
    """(M,) the same of the current sweep."""
    motion_m: F32
    """(M,2) way of each current point over the ground since the previous sweep."""
    centre_m: F32
    """(K,2,2) centres of the objects, previous and current."""
    seen: U8
    """(4,H,W) on EXAMPLE_GRID, in percent: unseen and seen-free of current, then previous."""
    elapsed_s: float
    """Time between the sweeps."""


def example_of(prepared: SweepPair, labels: Labels, grid: BevGrid) -> Example:
    """Join a prepared pair with its truth; `grid` is the one of its visibility rasters.

    The row numbers of the raw points must have come along as the sweeps' `time_offset_ns`.
    """
    then, now = prepared.previous, prepared.current
    rows_then, rows_now = _rows(then), _rows(now)
    cells = network_cells(EXAMPLE_GRID, EXAMPLE_GRID.cell_m, 1)
    seen = (prepared.current_seen, prepared.previous_seen)
    shares = seen_shares(seen, cell_of_centres(grid, cells), cells)
    return Example(
        previous=network_points(then.xyz_m, prepared.previous_height_m, then.reflectance),
        current=network_points(now.xyz_m, prepared.current_height_m, now.reflectance),
        previous_object=labels.previous_object[rows_then],
        current_object=labels.current_object[rows_now],
        motion_m=(labels.velocity_mps[rows_now] * prepared.elapsed_s).astype(np.float32),
        centre_m=labels.centre_m,
        seen=np.round(100 * shares).astype(np.uint8),
        elapsed_s=prepared.elapsed_s,
    )


def numbered(sweep: Sweep) -> Sweep:
    """The sweep with its row numbers in `time_offset_ns`, to be found again after selection."""
    return replace(sweep, time_offset_ns=np.arange(len(sweep), dtype=np.int64), ring=None)


def _rows(sweep: Sweep) -> I64:
    if sweep.time_offset_ns is None:
        raise InputError("time_offset_ns", None, "row numbers, see `numbered`")
    return sweep.time_offset_ns
