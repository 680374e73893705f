"""Geometric verification and refinement of a field.

The cells that a field says move fall into components of similar velocity. Each component's points
are registered to the previous sweep, starting from the component's median velocity. It is
withdrawn where rest explains the points as well, refined where its registration explains them
clearly better, left as it is where geometry cannot tell, and no longer valid where it is too few
points to tell and rest would do. This is done by component: cell by
cell, a car's side would be at rest, since it slides along itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.motion import FlowField
from mottrack.flow.registration.component_field import cell_displacements
from mottrack.flow.registration.components import moving_cells
from mottrack.flow.registration.matcher import Labels, MatchConfig, Matcher, Matches
from mottrack.flow.registration.motion_test import MotionTestConfig, explains, is_evident
from mottrack.flow.sweep_pair.prepared import SweepPair


class RefineConfig(StrictModel):
    """Which cells are taken for moving, and how their components are judged."""

    match: MatchConfig = Field(default_factory=MatchConfig)
    verdict: MotionTestConfig = Field(default_factory=MotionTestConfig)
    moving_mps: float = Field(0.5, gt=0, description="slower cells are at rest already")
    similar_mps: float = Field(1.0, gt=0, description="velocity step inside one component")
    similar_share: float = Field(0.35, ge=0, description="the same, as a share of the speed")
    min_points: int = Field(12, ge=1, description="fewer points fit any shift: not refined")
    max_correction_m: float = Field(0.5, gt=0, description="a larger correction is refused")
    tie_m: float = Field(0.008, ge=0, description="costs this close are equal: rest is likelier")
    min_passed: int = Field(5, ge=1, description="points seen through before: not at rest")
    passed_share: float = Field(0.03, ge=0, description="and at least this share of the points")
    doubt: float = Field(
        0.3, ge=0, le=1, description="withdrawn motions that were real all the same, a share"
    )


class Refiner:
    """Verifies and refines fields."""

    def __init__(self, config: RefineConfig | None = None) -> None:
        self.config = config or RefineConfig()

    def refine(self, field: FlowField, prepared: SweepPair) -> FlowField:
        """The field with each moving component withdrawn, refined or kept."""
        cells, count = moving_cells(
            field.velocity_mps,
            field.occupied & field.valid,
            (self.config.moving_mps, self.config.similar_mps, self.config.similar_share),
        )
        if count == 0 or len(prepared.previous) == 0 or len(prepared.current) == 0:
            return field
        matcher = Matcher(prepared, self.config.match)
        rows, cols, inside = field.grid.cells(matcher.points_m)
        labels = Labels(np.where(inside, cells[rows, cols], -1), count)
        start_m = -_medians(field.velocity_mps, cells, count) * prepared.elapsed_s
        starts = start_m, np.arange(count + 1)
        matches = matcher.match(labels, starts, min_points=self.config.min_points)
        claimed_m = matcher.costs(labels, start_m)
        refined, withdrawn = self._judge(matches, start_m, claimed_m)
        few = withdrawn & (matches.points < self.config.min_points)
        outcome = _Outcome(matches, refined, withdrawn & ~few, few, prepared.elapsed_s)
        return _applied(field, cells, outcome, self.config.doubt)

    def _judge(self, matches: Matches, start_m: F64, claimed_m: F64) -> tuple[Mask, Mask]:
        """(K,) components that take the registration's shift, and those that are at rest.

        At rest are those that rest explains at least as well as the estimator's own claim does,
        unless they stand where the previous sweep saw through: nothing at rest stands there.
        """
        # the estimator's hypothesis is evidence of its own
        believed = explains(matches, np.ones_like(matches.cost_m, np.bool_), self.config.verdict)
        believed |= is_evident(matches, self.config.verdict)
        correction_m = np.hypot(*(matches.shift_m - start_m).T)
        refined = believed & (matches.points >= self.config.min_points)
        refined &= correction_m < self.config.max_correction_m
        resting = ~believed & (matches.rest_cost_m <= claimed_m + self.config.tie_m)
        return refined, resting & ~self._passed(matches)

    def _passed(self, matches: Matches) -> Mask:
        least = np.maximum(self.config.min_passed, self.config.passed_share * matches.points)
        return np.asarray(matches.passed >= least)


@dataclass(frozen=True, slots=True)
class _Outcome:
    """What becomes of each component."""

    matches: Matches
    refined: Mask
    withdrawn: Mask
    unknown: Mask
    """Rest explains them as well, but they are too few points to tell."""
    elapsed_s: float


def _medians(velocity_mps: F32, cells: I64, count: int) -> F64:
    """(K, 2) median velocity of each component."""
    chosen = cells >= 0
    order = np.argsort(cells[chosen], kind="stable")
    parts = np.split(
        velocity_mps[chosen][order], np.searchsorted(cells[chosen][order], np.arange(1, count))
    )
    return np.array([np.median(part, axis=0) for part in parts], dtype=np.float64)


def _applied(field: FlowField, cells: I64, outcome: _Outcome, doubt: float) -> FlowField:
    """A withdrawn motion v was real with probability `doubt`: its covariance gains doubt v v^T."""
    rows, cols = np.nonzero(cells >= 0)
    owner = cells[rows, cols]
    take, drop = outcome.refined[owner], outcome.withdrawn[owner]
    velocity_mps = np.array(field.velocity_mps)
    covariance = np.array(field.covariance_m2ps2)
    variance = ((outcome.matches.sigma_m / outcome.elapsed_s) ** 2)[:, None, None] * np.eye(2)
    place_m = field.grid.centres_m()[rows[take], cols[take]]
    shift_m = cell_displacements(outcome.matches, owner[take], place_m)
    velocity_mps[rows[take], cols[take]] = shift_m / outcome.elapsed_s
    covariance[rows[take], cols[take]] = variance[owner[take]]
    claimed = velocity_mps[rows[drop], cols[drop]]
    covariance[rows[drop], cols[drop]] = (
        variance[owner[drop]] + doubt * claimed[:, :, None] * claimed[:, None, :]
    )
    velocity_mps[rows[drop], cols[drop]] = 0.0
    lost = outcome.unknown[owner]
    velocity_mps[rows[lost], cols[lost]] = 0.0
    valid = field.valid.copy()
    valid[rows[lost], cols[lost]] = False
    return replace(field, velocity_mps=velocity_mps, covariance_m2ps2=covariance, valid=valid)
