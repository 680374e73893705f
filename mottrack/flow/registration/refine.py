"""Geometric verification and refinement of a flow field.

The cells that a field claims to move form components of similar velocity. The points of each are
registered to the previous sweep, starting from the component's median velocity. Its motion is
withdrawn where zero motion explains the points as well, replaced where the registration explains
them clearly better, kept where geometry cannot tell, and no longer valid where the points are too
few to tell and zero motion would do. This is decided by component: cell by cell, the side of a car
would be at rest, since it slides along itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.motion import FlowField
from mottrack.flow.registration.components import moving_cells
from mottrack.flow.registration.kernels import Starts
from mottrack.flow.registration.matcher import Labels, MatchConfig, Matcher, Matches
from mottrack.flow.registration.motion_test import MotionTestConfig, explains, is_evident
from mottrack.flow.sweep_pair import SweepPair


class RefineConfig(StrictModel):
    """Which cells count as moving, and how their components are tested."""

    match: MatchConfig = Field(default_factory=MatchConfig)
    motion_test: MotionTestConfig = Field(default_factory=MotionTestConfig)
    moving_mps: float = Field(0.5, gt=0, description="slower cells count as at rest")
    similar_mps: float = Field(1.0, gt=0, description="velocity step inside one component")
    similar_share: float = Field(0.35, ge=0, description="the same, as a share of the speed")
    min_points: int = Field(12, ge=1, description="fewer points fit any shift: not refined")
    max_correction_m: float = Field(0.5, gt=0, description="a larger correction is refused")
    tie_m: float = Field(0.008, ge=0, description="costs this close are equal: rest is likelier")
    min_free_points: int = Field(
        5, ge=1, description="points in free space of the previous sweep that exclude rest"
    )
    free_share: float = Field(0.03, ge=0, description="and their least share of the points")
    p_wrongly_withdrawn: float = Field(
        0.3, ge=0, le=1, description="share of the withdrawn motions that were real"
    )


@dataclass(frozen=True, slots=True)
class _Outcome:
    """What becomes of each of K components."""

    matches: Matches
    refined: Mask
    withdrawn: Mask
    unknown: Mask
    """Zero motion explains them as well, but they have too few points to decide."""
    elapsed_s: float


def refine(field: FlowField, pair: SweepPair, config: RefineConfig) -> FlowField:
    """Return the field with each moving component withdrawn, refined or kept."""
    vx, vy = np.moveaxis(field.velocity_mps, -1, 0)
    # in 64 bits, so that a threshold is not rounded to the precision of the field
    moving = np.sqrt(vx * vx + vy * vy).astype(np.float64) > config.moving_mps
    moving &= field.occupied & field.valid
    cells, count = moving_cells(
        field.velocity_mps, moving, config.similar_mps, config.similar_share
    )
    if count == 0 or len(pair.previous) == 0 or len(pair.current) == 0:
        return field
    matcher = Matcher(pair, config.match)
    rows, cols, inside = field.grid.cells(matcher.points_m)
    labels = Labels(np.where(inside, cells[rows, cols], -1), count)
    start_m = -_medians(field.velocity_mps, cells, count) * pair.elapsed_s
    starts = Starts(start_m, np.arange(count + 1))
    matches = matcher.match(labels, starts, min_points=config.min_points)
    refined, at_rest = _test(matches, start_m, matcher.costs(labels, start_m), config)
    few = at_rest & (matches.points < config.min_points)
    outcome = _Outcome(matches, refined, at_rest & ~few, few, pair.elapsed_s)
    return _applied(field, cells, outcome, config.p_wrongly_withdrawn)


def _test(
    matches: Matches, start_m: F64, claimed_m: F64, config: RefineConfig
) -> tuple[Mask, Mask]:
    """Return (K,) components that take the registration's shift, and those that are at rest.

    At rest are those that zero motion explains at least as well as the estimator's own claim
    does, unless they lie in free space of the previous sweep: nothing at rest can.
    """
    # the estimator's hypothesis is evidence of its own
    moving = explains(matches, np.ones_like(matches.cost_m, np.bool_), config.motion_test)
    moving |= is_evident(matches, config.motion_test)
    correction_m = np.hypot(*(matches.shift_m - start_m).T)
    refined = moving & (matches.points >= config.min_points)
    refined &= correction_m < config.max_correction_m
    at_rest = ~moving & (matches.zero_motion_cost_m <= claimed_m + config.tie_m)
    least = np.maximum(config.min_free_points, config.free_share * matches.points)
    return refined, at_rest & ~(matches.in_free_space >= least)


def _medians(velocity_mps: F32, cells: I64, count: int) -> F64:
    """Return (K, 2) the median velocity of each component."""
    chosen = cells >= 0
    order = np.argsort(cells[chosen], kind="stable")
    parts = np.split(
        velocity_mps[chosen][order], np.searchsorted(cells[chosen][order], np.arange(1, count))
    )
    return np.array([np.median(part, axis=0) for part in parts], dtype=np.float64)


def _applied(field: FlowField, cells: I64, outcome: _Outcome, p_real: float) -> FlowField:
    """Apply the outcome. A withdrawn v was real with probability p: covariance gains p v v^T."""
    rows, cols = np.nonzero(cells >= 0)
    owner = cells[rows, cols]
    take, drop, lost = outcome.refined[owner], outcome.withdrawn[owner], outcome.unknown[owner]
    velocity_mps = np.array(field.velocity_mps)
    covariance = np.array(field.covariance_m2ps2)
    variance = ((outcome.matches.sigma_m / outcome.elapsed_s) ** 2)[:, None, None] * np.eye(2)
    place_m = field.grid.centres_m()[rows[take], cols[take]]
    displacement_m = outcome.matches.displacements_m(owner[take], place_m)
    velocity_mps[rows[take], cols[take]] = displacement_m / outcome.elapsed_s
    covariance[rows[take], cols[take]] = variance[owner[take]]
    claimed = velocity_mps[rows[drop], cols[drop]]
    covariance[rows[drop], cols[drop]] = (
        variance[owner[drop]] + p_real * claimed[:, :, None] * claimed[:, None, :]
    )
    velocity_mps[rows[drop | lost], cols[drop | lost]] = 0.0
    valid = field.valid.copy()
    valid[rows[lost], cols[lost]] = False
    return replace(field, velocity_mps=velocity_mps, covariance_m2ps2=covariance, valid=valid)
