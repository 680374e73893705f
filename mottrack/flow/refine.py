"""Geometric verification and refinement of a field.

The cells that a field says move fall into components of similar velocity. Each component's points
are registered to the previous sweep, starting from the component's median velocity. It is
withdrawn where rest explains the points as well, refined where its registration explains them
clearly better, and left as it is where geometry cannot tell. This is done by component: cell by
cell, a car's side would be at rest, since it slides along itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.motion import FlowField
from mottrack.flow.clusters import moving_cells
from mottrack.flow.matcher import Labels, MatchConfig, Matcher, Matches
from mottrack.flow.prepared import Prepared
from mottrack.flow.verdict import VerdictConfig, explains


class RefineConfig(StrictModel):
    """Which cells are taken for moving, and how their components are judged."""

    match: MatchConfig = Field(default_factory=MatchConfig)
    verdict: VerdictConfig = Field(default_factory=VerdictConfig)
    moving_mps: float = Field(0.5, gt=0, description="slower cells are at rest already")
    similar_mps: float = Field(1.0, gt=0, description="velocity step inside one component")
    similar_share: float = Field(0.35, ge=0, description="the same, as a share of the speed")
    max_correction_m: float = Field(0.8, gt=0, description="a larger correction is refused")
    rest_cost_m: float = Field(0.1, ge=0, description="points that rest explains to this rest")
    rest_ratio: float = Field(
        0.85, gt=0, le=1, description="rest, too, where no shift costs less than this share of it"
    )


class Refiner:
    """Verifies and refines fields."""

    def __init__(self, config: RefineConfig | None = None) -> None:
        self.config = config or RefineConfig()

    def refine(self, field: FlowField, prepared: Prepared) -> FlowField:
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
        median_mps = _medians(field.velocity_mps, cells, count)
        start_m = -median_mps * prepared.elapsed_s
        matches = matcher.match(labels, (start_m, np.arange(count + 1)))
        refined, withdrawn = self._judge(matches, start_m)
        velocity_mps = np.where(refined[:, None], -matches.shift_m / prepared.elapsed_s, median_mps)
        return _applied(field, cells, (velocity_mps, refined, withdrawn))

    def _judge(
        self, matches: Matches, start_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(K,) components that take the registration's shift, and those that are at rest."""
        # the estimator's hypothesis is evidence of its own
        believed = explains(matches, np.ones_like(matches.cost_m, np.bool_), self.config.verdict)
        correction_m = np.hypot(*(matches.shift_m - start_m).T)
        refined = believed & (correction_m < self.config.max_correction_m)
        rests_well = matches.rest_cost_m < self.config.rest_cost_m
        no_better = matches.cost_m > self.config.rest_ratio * matches.rest_cost_m
        return refined, ~believed & (rests_well | no_better)


def _medians(
    velocity_mps: NDArray[np.float32], cells: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """(K, 2) median velocity of each component."""
    chosen = cells >= 0
    order = np.argsort(cells[chosen], kind="stable")
    parts = np.split(
        velocity_mps[chosen][order], np.searchsorted(cells[chosen][order], np.arange(1, count))
    )
    return np.array([np.median(part, axis=0) for part in parts], dtype=np.float64)


def _applied(
    field: FlowField,
    cells: NDArray[np.int64],
    judged: tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]],
) -> FlowField:
    velocity_mps, refined, withdrawn = judged
    take = (cells >= 0) & np.append(refined, False)[cells]
    drop = (cells >= 0) & np.append(withdrawn, False)[cells]
    padded = np.vstack([velocity_mps, np.zeros((1, 2))]).astype(np.float32)
    changed = np.where(take[..., None], padded[cells], field.velocity_mps)
    return replace(field, velocity_mps=np.where(drop[..., None], np.float32(0), changed))
