"""Which components move: their best shift must explain clearly more than rest does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import Mask
from mottrack.flow.registration.matcher import Labels, Matches


class MotionTestConfig(StrictModel):
    """When a shift is believed."""

    near_m: float = Field(0.5, gt=0, description="a shift within ICP's own reach from rest")
    loose_ratio: float = Field(
        0.7, gt=0, le=1, description="cost of a shift over that of rest, with much evidence"
    )
    strict_ratio: float = Field(
        0.5, gt=0, le=1, description="the same with little: few points, or far and nothing passed"
    )
    advantage_m: float = Field(0.02, ge=0, description="cost of rest less that of the shift")
    strict_over_floor_m: float = Field(
        0.04, gt=0, description="cost, with little evidence, above what resting components cost"
    )
    loose_over_floor_m: float = Field(0.1, gt=0, description="the same with much evidence")
    min_points: int = Field(12, ge=1, description="with fewer points a far shift fits anywhere")
    min_points_near: int = Field(6, ge=1, description="fewer than this are never believed")
    many_points: int = Field(20, ge=1, description="a near shift of so many has much evidence")
    min_passed: int = Field(
        5, ge=1, description="points where the previous sweep saw through: much evidence"
    )
    passed_share: float = Field(
        0.05, ge=0, description="with this share of them, too, nothing at rest has stood there"
    )
    significant: float = Field(
        6.0, gt=0, description="standard errors by which a shift must explain a large component"
    )
    significant_points: int = Field(60, ge=1, description="points of a large component")
    evident_ratio: float = Field(
        0.87, gt=0, le=1, description="cost over that of rest where points passed or significant"
    )
    seen_share: float = Field(
        0.5, ge=0, description="points that speak about rest, as a share of those compared"
    )


@dataclass(frozen=True, slots=True)
class MotionDecision:
    """Components, what was found for each, and which of them move."""

    labels: Labels
    matches: Matches
    moving: Mask
    """(K,) components whose shift is believed; the others rest or were not seen before."""


def is_moving(matches: Matches, config: MotionTestConfig) -> Mask:
    """(K,) components whose shift is believed, with enough points for how far it is."""
    far = _is_far(matches, config)
    enough = matches.points >= np.where(far, config.min_points, config.min_points_near)
    strong = np.where(
        far, matches.passed >= config.min_passed, matches.points >= config.many_points
    )
    moving: Mask = explains(matches, strong, config) & enough
    moving |= is_evident(matches, config)
    return moving


def is_evident(matches: Matches, config: MotionTestConfig) -> Mask:
    """(K,) components that certainly moved, even where a sparse sensor fits every shift badly.

    They stand where the previous sweep saw through, or are so many points that a small gain is
    far outside of what noise can do.
    """
    passed = matches.passed >= np.maximum(config.min_passed, config.passed_share * matches.points)
    significant = matches.significance > config.significant
    significant &= matches.points >= config.significant_points
    better = matches.cost_m < config.evident_ratio * matches.rest_cost_m
    better &= matches.cost_m < noise_floor(matches, config) + config.loose_over_floor_m
    evident: Mask = (passed | significant) & better
    return evident


def explains(matches: Matches, strong: Mask, config: MotionTestConfig) -> Mask:
    """(K,) components whose shift leaves clearly less unexplained than rest, and little.

    A far shift is one of very many that were tried, so without further evidence (`strong`) it
    must fit about as well as components at rest do (the floor: range noise and sampling of this
    sensor). Where the previous sweep hardly saw the component's place, nothing speaks against
    rest.
    """
    ratio = np.where(strong, config.loose_ratio, config.strict_ratio)
    over_m = np.where(strong, config.loose_over_floor_m, config.strict_over_floor_m)
    clear = matches.cost_m < ratio * matches.rest_cost_m
    clear &= matches.rest_cost_m - matches.cost_m > config.advantage_m
    clear &= matches.compared > config.seen_share * np.minimum(matches.points, matches.sampled)
    return clear & (matches.cost_m < noise_floor(matches, config) + over_m)


def noise_floor(matches: Matches, config: MotionTestConfig) -> float:
    """Median cost of rest of the larger components: most of any scene rests."""
    large = matches.points >= config.min_points
    return float(np.median(matches.rest_cost_m[large])) if large.any() else 0.0


def _is_far(matches: Matches, config: MotionTestConfig) -> Mask:
    return np.hypot(matches.shift_m[:, 0], matches.shift_m[:, 1]) > config.near_m
