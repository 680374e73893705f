"""The motion test: a component moves if a motion explains clearly more of it than zero motion.

Fragments, too small to have a motion of their own (a mirror, a roof, the far corner of a car seen
through another one), are then tested with the motion of a moving neighbour only: any shift fits a
few points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, I64, Mask
from mottrack.flow.registration.matcher import Labels, Matcher, Matches
from mottrack.lidar.point_grid import PointGrid, build_point_grid, nearest

_FRAGMENT_GAP_M = 1.5
"""Farthest gap between a fragment and the rest of its vehicle."""
_FRAGMENT_POINTS = 40
"""Components with as many points have a motion of their own."""
_AT_REST_M = 0.05
"""A fragment whose zero-motion cost is this close to the noise floor stays at rest, whatever moves
past it."""


class MotionTestConfig(StrictModel):
    """Thresholds of the motion test; costs are mean truncated distances in metres."""

    near_m: float = Field(0.5, gt=0, description="a shift that ICP itself reaches from zero motion")
    loose_ratio: float = Field(
        0.7, gt=0, le=1, description="cost over zero-motion cost, at most, with much evidence"
    )
    strict_ratio: float = Field(
        0.5,
        gt=0,
        le=1,
        description="the same with little: few points, or far and none in free space",
    )
    advantage_m: float = Field(0.02, ge=0, description="least gain over the zero-motion cost")
    strict_over_floor_m: float = Field(
        0.04, gt=0, description="cost, with little evidence, above that of components at rest"
    )
    loose_over_floor_m: float = Field(0.1, gt=0, description="the same with much evidence")
    min_points: int = Field(12, ge=1, description="with fewer points a far shift fits anywhere")
    min_points_near: int = Field(6, ge=1, description="with fewer points a component is at rest")
    many_points: int = Field(20, ge=1, description="points of a near shift that are much evidence")
    min_free_points: int = Field(
        5, ge=1, description="points where the previous sweep saw free space: much evidence"
    )
    free_share: float = Field(
        0.05, ge=0, description="and their least share, to exclude that the component was at rest"
    )
    significant: float = Field(
        6.0, gt=0, description="standard errors by which a motion must explain a large component"
    )
    significant_points: int = Field(60, ge=1, description="points of a large component")
    evident_ratio: float = Field(
        0.87,
        gt=0,
        le=1,
        description="cost over zero-motion cost where in free space or significant",
    )
    seen_share: float = Field(
        0.5, ge=0, description="least share of the compared points with a zero-motion distance"
    )


@dataclass(frozen=True, slots=True)
class MotionDecision:
    """Components, the best motion of each, and which of them move."""

    labels: Labels
    matches: Matches
    moving: Mask
    """(K,) components that move; the others are at rest or were not seen before."""


def is_moving(matches: Matches, config: MotionTestConfig) -> Mask:
    """Return (K,) components that move, with enough points for the length of their shift."""
    far = np.hypot(matches.shift_m[:, 0], matches.shift_m[:, 1]) > config.near_m
    enough = matches.points >= np.where(far, config.min_points, config.min_points_near)
    free, many = (
        matches.in_free_space >= config.min_free_points,
        matches.points >= config.many_points,
    )
    moving = explains(matches, np.where(far, free, many), config) & enough
    return moving | is_evident(matches, config)


def is_evident(matches: Matches, config: MotionTestConfig) -> Mask:
    """Return (K,) components that certainly moved, even where a sparse sensor fits nothing well.

    They stand where the previous sweep saw free space, or have so many points that a small gain is
    far beyond the noise.
    """
    least = np.maximum(config.min_free_points, config.free_share * matches.points)
    significant = matches.significance > config.significant
    significant &= matches.points >= config.significant_points
    better = matches.cost_m < config.evident_ratio * matches.zero_motion_cost_m
    better &= matches.cost_m < noise_floor(matches, config) + config.loose_over_floor_m
    evident: Mask = (matches.in_free_space >= least) | significant
    return evident & better


def explains(matches: Matches, strong: Mask, config: MotionTestConfig) -> Mask:
    """Return (K,) components whose motion leaves clearly less unexplained than none, and little.

    A far shift is one of very many that were tried, so without further evidence (`strong`) it must
    fit about as well as components at rest do (the noise floor: range noise and sampling of this
    sensor). Where the previous sweep hardly saw the component's place, nothing contradicts zero
    motion.
    """
    ratio = np.where(strong, config.loose_ratio, config.strict_ratio)
    over_m = np.where(strong, config.loose_over_floor_m, config.strict_over_floor_m)
    clear = matches.cost_m < ratio * matches.zero_motion_cost_m
    clear &= matches.zero_motion_cost_m - matches.cost_m > config.advantage_m
    comparable = np.minimum(matches.points, matches.max_points)
    clear &= matches.compared > config.seen_share * comparable
    return clear & (matches.cost_m < noise_floor(matches, config) + over_m)


def noise_floor(matches: Matches, config: MotionTestConfig) -> float:
    """Return the median zero-motion cost of larger components: most of any scene is at rest."""
    large = matches.points >= config.min_points
    return float(np.median(matches.zero_motion_cost_m[large])) if large.any() else 0.0


def move_fragments(
    matcher: Matcher, decision: MotionDecision, config: MotionTestConfig
) -> MotionDecision:
    """Give small components near a moving one its motion, where that explains them.

    The motion found for a fragment itself counts only where no larger neighbour moves, or where
    the neighbour's shift explains it no better than zero motion.
    """
    matches, of_point = decision.matches, decision.labels.of_point
    leads = decision.moving & (matches.points >= config.min_points)
    if not leads.any():
        return decision
    leaders = np.flatnonzero((of_point >= 0) & leads[of_point])
    small = ~leads & (matches.points < _FRAGMENT_POINTS)
    others = np.flatnonzero((of_point >= 0) & small[of_point])
    flat_m = matcher.points_m * np.array([1, 1, 0], np.float32)
    grid = build_point_grid(flat_m[leaders], _FRAGMENT_GAP_M, matcher.raster.x_max_m)
    leader_of = np.full(decision.labels.count, -1)
    _nearest_leaders(grid, flat_m[others], of_point[others], of_point[leaders], leader_of)
    near, led_m = leader_of >= 0, matches.shift_m[leader_of]
    fragments = np.where(near[of_point] & (of_point >= 0), of_point, -1)
    cost_m = matcher.costs(Labels(fragments, decision.labels.count), led_m)
    unexplained = matches.zero_motion_cost_m > noise_floor(matches, config) + _AT_REST_M
    joins = near & unexplained & (cost_m <= matches.zero_motion_cost_m)
    matches = replace(
        matches,
        turn_rad=np.where(joins, matches.turn_rad[leader_of], matches.turn_rad),
        centre_m=np.where(joins[:, None], matches.centre_m[leader_of], matches.centre_m),
        shift_m=np.where(joins[:, None], led_m, matches.shift_m),
        cost_m=np.where(joins, cost_m, matches.cost_m),
    )
    return replace(decision, matches=matches, moving=decision.moving | joins)


@compiled
def _nearest_leaders(
    grid: PointGrid, points_m: F32, component_of: I64, leader_at: I64, leader_of: I64
) -> None:
    """Fill `leader_of` (K,) with the moving component nearest to each fragment, if one is near."""
    best = np.full(len(leader_of), np.inf)
    for i in range(len(points_m)):
        k, d2 = nearest(grid, points_m[i, 0], points_m[i, 1], 0.0, _FRAGMENT_GAP_M)
        if k >= 0 and d2 < best[component_of[i]]:
            best[component_of[i]] = d2
            leader_of[component_of[i]] = leader_at[grid.order[k]]
