"""Pieces too small to have a motion of their own follow a moving neighbour.

A mirror, a roof or the far corner of a car seen through another one is a component of a few
points. Any shift fits a few points, so only that of a near, moving component is tried.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mottrack.flow.matcher import Matcher, Matches
from mottrack.flow.verdict import Judged, VerdictConfig, explains
from mottrack.lidar.point_grid import PointGrid, build_point_grid, nearest

_NEAR_M = 1.5
"""Farthest gap between a piece and the rest of its vehicle."""
_STRAY_M = 0.4
"""How far the piece's own registration may end from its neighbour's shift."""


def follow_neighbours(matcher: Matcher, judged: Judged, config: VerdictConfig) -> Judged:
    """The same components, of which resting pieces near a moving one may now move with it."""
    of_point, moving = judged.labels.of_point, judged.moving
    if not moving.any():
        return judged
    leaders = np.flatnonzero((of_point >= 0) & moving[of_point])
    others = np.flatnonzero((of_point >= 0) & ~moving[of_point])
    flat_m = matcher.points_m * np.array([1, 1, 0], np.float32)
    grid = build_point_grid(flat_m[leaders], _NEAR_M, matcher.raster.x_max_m)
    leader_of = np.asarray(
        _leaders(grid, flat_m[others], of_point[others], of_point[leaders], judged.labels.count)
    )
    followers = np.flatnonzero(leader_of >= 0)
    first = np.searchsorted(followers, np.arange(judged.labels.count + 1))
    starts_m = judged.matches.shift_m[leader_of[followers]]
    tried = matcher.match(judged.labels, (starts_m, first))
    stray_m = np.full(judged.labels.count, np.inf)
    stray_m[followers] = np.hypot(*(tried.shift_m[followers] - starts_m).T)
    joins = explains(tried, config) & (stray_m < _STRAY_M)
    shift_m = judged.matches.shift_m.copy()
    shift_m[joins] = judged.matches.shift_m[leader_of[joins]]
    cost_m = np.where(joins, tried.cost_m, judged.matches.cost_m)
    matches: Matches = replace(judged.matches, shift_m=shift_m, cost_m=cost_m)
    return replace(judged, matches=matches, moving=moving | joins)


@njit(cache=True)
def _leaders(
    grid: PointGrid,
    points_m: NDArray[np.float32],
    component_of: NDArray[np.int64],
    leader_at: NDArray[np.int64],
    count: int,
) -> NDArray[np.int64]:
    """(K,) the moving component nearest to each resting one, -1 where none is near."""
    leader_of = np.full(count, -1, np.int64)
    best = np.full(count, np.inf)
    for i in range(len(points_m)):
        k, d2 = nearest(grid, points_m[i, 0], points_m[i, 1], 0.0, _NEAR_M)
        if k >= 0 and d2 < best[component_of[i]]:
            best[component_of[i]] = d2
            leader_of[component_of[i]] = leader_at[grid.order[k]]
    return leader_of
