"""Pieces too small to have a motion of their own follow a moving neighbour.

A mirror, a roof or the far corner of a car seen through another one is a component of a few
points. Any shift fits a few points, so only that of a near, moving component is tried.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I64
from mottrack.flow.registration.matcher import Labels, Matcher
from mottrack.flow.registration.motion_test import MotionDecision, MotionTestConfig, noise_floor
from mottrack.lidar.point_grid import PointGrid, build_point_grid, nearest

_NEAR_M = 1.5
"""Farthest gap between a piece and the rest of its vehicle."""
_SMALL = 40
"""Points above which a component has a motion of its own."""
_AT_REST_M = 0.05
"""A piece that rest explains this close to the floor stays at rest, whoever passes by."""


def follow_neighbours(
    matcher: Matcher, judged: MotionDecision, config: MotionTestConfig
) -> MotionDecision:
    """The same components, of which small ones near a moving one may now move with it.

    What a small piece found on its own counts only where no larger neighbour moves, or where the
    neighbour's shift explains it no better than rest.
    """
    of_point, points = judged.labels.of_point, judged.matches.points
    leads = judged.moving & (points >= config.min_points)
    if not leads.any():
        return judged
    leaders = np.flatnonzero((of_point >= 0) & leads[of_point])
    others = np.flatnonzero((of_point >= 0) & (~leads & (points < _SMALL))[of_point])
    flat_m = matcher.points_m * np.array([1, 1, 0], np.float32)
    grid = build_point_grid(flat_m[leaders], _NEAR_M, matcher.raster.x_max_m)
    leader_of = np.asarray(
        _leaders(grid, flat_m[others], of_point[others], of_point[leaders], judged.labels.count)
    )
    near = leader_of >= 0
    led_m = judged.matches.shift_m[leader_of]
    pieces = Labels(np.where(near[of_point] & (of_point >= 0), of_point, -1), judged.labels.count)
    cost_m = matcher.costs(pieces, led_m)
    rest_m = judged.matches.rest_cost_m
    unexplained = rest_m > noise_floor(judged.matches, config) + _AT_REST_M
    joins = near & unexplained & (cost_m <= rest_m)
    matches = replace(
        judged.matches,
        turn_rad=np.where(joins, judged.matches.turn_rad[leader_of], judged.matches.turn_rad),
        centre_m=np.where(
            joins[:, None], judged.matches.centre_m[leader_of], judged.matches.centre_m
        ),
        shift_m=np.where(joins[:, None], led_m, judged.matches.shift_m),
        cost_m=np.where(joins, cost_m, judged.matches.cost_m),
    )
    return replace(judged, matches=matches, moving=judged.moving | joins)


@compiled
def _leaders(
    grid: PointGrid,
    points_m: F32,
    component_of: I64,
    leader_at: I64,
    count: int,
) -> I64:
    """(K,) the moving component nearest to each resting one, -1 where none is near."""
    leader_of = np.full(count, -1, np.int64)
    best = np.full(count, np.inf)
    for i in range(len(points_m)):
        k, d2 = nearest(grid, points_m[i, 0], points_m[i, 1], 0.0, _NEAR_M)
        if k >= 0 and d2 < best[component_of[i]]:
            best[component_of[i]] = d2
            leader_of[component_of[i]] = leader_at[grid.order[k]]
    return leader_of
