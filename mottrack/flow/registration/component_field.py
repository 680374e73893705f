"""A flow field from components and their shifts."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F32, F64, I64
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.flow.registration.matcher import Matcher, Matches
from mottrack.flow.registration.motion_test import MotionDecision
from mottrack.flow.sweep_pair.prepared import SweepPair


def component_field(
    grid: BevGrid, prepared: SweepPair, matcher: Matcher, judged: MotionDecision
) -> FlowField:
    """Velocity of each occupied cell from the component that holds most of its points.

    Valid are the cells of components that move, and of those at rest that the previous sweep saw
    well enough to say so; what it could not see is occupied and not valid.
    """
    matches, moving = judged.matches, judged.moving
    seen = moving | ((matches.compared > 0) & (matches.rest_cost_m < matcher.config.cap_m / 2))
    sigma_mps = matches.sigma_m / prepared.elapsed_s
    xyz_m = prepared.current.xyz_m
    owner = _owners(grid, matcher, xyz_m, judged)
    occupied = grid.occupancy(xyz_m)
    # the row that -1 picks stands for cells without a component
    valid = occupied & np.append(seen, False)[owner]
    moves = np.append(moving, False)[owner] & valid
    field_mps = np.zeros((*grid.shape, 2))
    field_mps[moves] = cell_displacements(matches, owner[moves], grid.centres_m()[moves])
    field_mps /= prepared.elapsed_s
    variance = np.append(sigma_mps**2, 0.0)[owner] * valid
    return FlowField(
        grid=grid,
        velocity_mps=field_mps.astype(np.float32),
        covariance_m2ps2=variance.astype(np.float32)[..., None, None] * np.eye(2, dtype=np.float32),
        occupied=occupied,
        valid=valid,
        weight=occupied.astype(np.float32),
        stamp_ns=prepared.current.stamp_ns,
    )


def cell_displacements(matches: Matches, owner: I64, xy_m: F64) -> F64:
    """(C, 2) displacement since the previous sweep of places (C, 2) on components (C,)."""
    cos, sin = np.cos(matches.turn_rad[owner]) - 1, np.sin(matches.turn_rad[owner])
    dx, dy = (xy_m - matches.centre_m[owner]).T
    turned_m = np.column_stack([cos * dx - sin * dy, sin * dx + cos * dy])
    return -(turned_m + matches.shift_m[owner])


def _owners(grid: BevGrid, matcher: Matcher, xyz_m: F32, judged: MotionDecision) -> I64:
    """(H, W) component with most points in each cell, -1 for none."""
    label_at = np.full(matcher.raster.shape, -1, np.int64)
    rows, cols, _ = matcher.raster.cells(matcher.points_m)
    label_at[rows, cols] = judged.labels.of_point
    rows, cols, _ = matcher.raster.cells(xyz_m)
    label_of = label_at[rows, cols]
    rows, cols, inside = grid.cells(xyz_m)
    usable = inside & (label_of >= 0)
    count = max(judged.labels.count, 1)
    key = (rows * grid.shape[1] + cols)[usable] * count + label_of[usable]
    pairs, hits = np.unique(key, return_counts=True)
    owner = np.full(grid.shape, -1, np.int64)
    by_hits = np.argsort(hits, kind="stable")
    owner.reshape(-1)[pairs[by_hits] // count] = pairs[by_hits] % count
    return owner
