"""Flow without boxes and without learning: registration of connected components, many starts each.

The obstacle points of the current sweep form connected components. Each is registered to the
previous sweep from zero motion and from the best displacements of an occupancy correlation. It is
taken as moving only where its displacement explains clearly more, in both directions, than zero
motion; what one sweep could not see is no evidence. Small fragments without a motion of their own
take that of a moving neighbour if it explains them better.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, I64
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep
from mottrack.flow.registration.components import connected_cells
from mottrack.flow.registration.matcher import Labels, MatchConfig, Matcher
from mottrack.flow.registration.motion_test import (
    MotionDecision,
    MotionTestConfig,
    is_moving,
    move_fragments,
)
from mottrack.flow.shipped_errors import shipped_errors
from mottrack.flow.stages import Stages, StagesConfig, VisibilityStage
from mottrack.flow.sweep_pair import (
    SweepPair,
    elapsed_seconds,
    flow_field,
    is_measurable,
    unmeasured,
)


class ClusterIcpConfig(StrictModel):
    """How sweeps are prepared, components formed, registered and tested for motion."""

    stages: StagesConfig = Field(
        default_factory=lambda: StagesConfig(visibility=VisibilityStage(enabled=False))
    )
    match: MatchConfig = Field(default_factory=MatchConfig)
    motion_test: MotionTestConfig = Field(default_factory=MotionTestConfig)
    far_m: float = Field(25.0, ge=0, description="beyond, cells are linked across an empty one")


class ClusterIcpFlow(FlowSourceBase):
    """Velocity of each connected component by registration from many starts."""

    Config = ClusterIcpConfig
    error_model = shipped_errors("cluster_icp")

    def __init__(
        self, config: ClusterIcpConfig | None = None, *, grid: BevGrid | None = None
    ) -> None:
        self.config = config or ClusterIcpConfig()
        self.grid = grid or BevGrid()
        self._stages = Stages(self.config.stages, self.grid)

    def reset(self) -> None:
        """Remove the features of earlier sweeps."""
        self._stages.reset()

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Return the field of every component that could be compared; none over a gap or a jump.

        Raises:
            InputError: the sweeps are not in order of time.
        """
        elapsed_seconds(past, current)
        if not is_measurable(past[-1], current):
            return unmeasured(self.grid, self._stages.features_of(current).obstacles[0])
        pair = self._stages.before(past, current)
        if len(pair.previous) == 0 or len(pair.current) == 0:
            return unmeasured(self.grid, pair.current)
        matcher = Matcher(pair, self.config.match)
        labels = Labels(*connected_cells(matcher.points_m, matcher.raster, self.config.far_m))
        matches = matcher.match(labels)
        decision = MotionDecision(labels, matches, is_moving(matches, self.config.motion_test))
        decision = move_fragments(matcher, decision, self.config.motion_test)
        return component_field(self.grid, pair, matcher, decision)


def component_field(
    grid: BevGrid, pair: SweepPair, matcher: Matcher, decision: MotionDecision
) -> FlowField:
    """Return the velocity of each occupied cell from the component with most points in it.

    Valid are the cells of components that move, and of those at rest that the previous sweep saw
    well enough to tell; what it could not see is occupied and not valid.
    """
    matches, moving = decision.matches, decision.moving
    known = matches.zero_motion_cost_m < matcher.config.truncation_m / 2
    known = moving | ((matches.compared > 0) & known)
    owner = _owners(grid, matcher, pair.current.xyz_m, decision.labels)
    # the last row is picked by -1: cells without a component
    valid, moves = np.append(known, False)[owner], np.append(moving, False)[owner]
    velocity_mps = np.zeros((*grid.shape, 2))
    velocity_mps[moves] = matches.displacements_m(owner[moves], grid.centres_m()[moves])
    velocity_mps /= pair.elapsed_s
    variance = np.append((matches.sigma_m / pair.elapsed_s) ** 2, 0.0)[owner]
    return flow_field(grid, pair.current, velocity_mps, valid, variance)


def _owners(grid: BevGrid, matcher: Matcher, xyz_m: F32, labels: Labels) -> I64:
    """Return (H, W) the component with most points in each cell, -1 for none."""
    label_at = np.full(matcher.raster.shape, -1, np.int64)
    rows, cols, _ = matcher.raster.cells(matcher.points_m)
    label_at[rows, cols] = labels.of_point
    rows, cols, _ = matcher.raster.cells(xyz_m)
    label_of = label_at[rows, cols]
    rows, cols, inside = grid.cells(xyz_m)
    usable = inside & (label_of >= 0)
    count = max(labels.count, 1)
    key = (rows * grid.shape[1] + cols)[usable] * count + label_of[usable]
    pairs, hits = np.unique(key, return_counts=True)
    owner = np.full(grid.shape, -1, np.int64)
    by_hits = np.argsort(hits, kind="stable")  # the last assignment to a cell has most points
    owner.reshape(-1)[pairs[by_hits] // count] = pairs[by_hits] % count
    return owner
