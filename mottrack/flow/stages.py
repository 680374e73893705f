"""The steps around a flow estimator, each a named stage that a config switches.

    prepared = stages.before(previous, current)     # ground, alignment, visibility
    raw = ...                                       # any estimator, on prepared.previous/current
    refined = stages.after(raw, prepared)           # visibility rule, verification and refinement

The raw field and the refined one are both worth reporting: the second is the estimator plus
geometry.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.flow.elapsed import elapsed_seconds
from mottrack.flow.kept_points import GroundStage, keep_points
from mottrack.flow.prepared import Prepared
from mottrack.flow.refine import RefineConfig, Refiner
from mottrack.lidar.alignment import AlignmentConfig, residual_motion
from mottrack.lidar.visibility import OCCUPIED, UNSEEN, visibility_raster

_NEAR_M = 0.5
"""How far off an earlier place may be and still be the one that a velocity names."""


class AlignmentStage(AlignmentConfig):
    """Correction of the odometry between the two sweeps."""

    enabled: bool = Field(True, description="align the sweeps by their non-ground points")


class VisibilityStage(StrictModel):
    """What the previous sweep could see."""

    enabled: bool = Field(True, description="make the visibility rasters")
    rule: bool = Field(True, description="no velocity for cells the previous sweep did not see")


class RefineStage(RefineConfig):
    """Geometric verification and refinement of moving components."""

    enabled: bool = Field(True, description="verify and refine the field")


class StagesConfig(StrictModel):
    """All stages."""

    ground: GroundStage = Field(default_factory=GroundStage)
    alignment: AlignmentStage = Field(default_factory=AlignmentStage)
    visibility: VisibilityStage = Field(default_factory=VisibilityStage)
    refine: RefineStage = Field(default_factory=RefineStage)


class Stages:
    """The steps before and after an estimator."""

    def __init__(self, config: StagesConfig | None = None, grid: BevGrid | None = None) -> None:
        """`grid` is the grid of the visibility rasters and of the fields given to `after`."""
        self.config = config or StagesConfig()
        self.grid = grid or BevGrid()
        self._refiner = Refiner(self.config.refine)

    def before(self, previous: Sweep, current: Sweep) -> Prepared:
        """Removes ground and ego motion from two sweeps, each in its own ego frame.

        Raises:
            InputError: ``current`` is not later than ``previous``.
        """
        elapsed_s = elapsed_seconds(previous, current)
        then, then_height_m = keep_points(previous, self.config.ground)
        now, now_height_m = keep_points(current, self.config.ground)
        full = previous.seen_from(current)
        then = then.seen_from(current)
        correction = Pose.identity()
        if self.config.alignment.enabled:
            correction = residual_motion(then.xyz_m, now.xyz_m, self.config.alignment)
            then, full = _moved(then, correction), _moved(full, correction)
        seen = self.config.visibility.enabled
        return Prepared(
            previous=then,
            current=now,
            previous_full=full,
            current_full=current,
            previous_height_m=then_height_m,
            current_height_m=now_height_m,
            elapsed_s=elapsed_s,
            correction=correction,
            previous_seen=visibility_raster(full, then.xyz_m, self.grid) if seen else None,
            current_seen=visibility_raster(current, now.xyz_m, self.grid) if seen else None,
        )

    def after(self, field: FlowField, prepared: Prepared) -> FlowField:
        """The field with the rules of geometry applied: visibility, verification, refinement.

        Raises:
            InputError: the field does not lie on the grid of these stages.
        """
        if field.grid != self.grid:
            raise InputError("grid of field", field.grid, str(self.grid))
        if self.config.visibility.rule and prepared.previous_seen is not None:
            field = silence_unseen(field, prepared.previous_seen, prepared.elapsed_s)
        if self.config.refine.enabled:
            field = self._refiner.refine(field, prepared)
        return field


def silence_unseen(
    field: FlowField, previous_seen: NDArray[np.int8], elapsed_s: float
) -> FlowField:
    """Withdraws the velocity of cells (H, W) whose place the previous sweep could not see.

    What was hidden and has come into view matches nothing; an estimator invents a fast match. A
    vehicle that has driven into what was hidden is told by its earlier place: something stood
    there. It keeps its velocity.
    """
    unseen = field.occupied & (previous_seen == UNSEEN)
    unseen[unseen] = ~_came_from(field, unseen, previous_seen == OCCUPIED, elapsed_s)
    return replace(
        field,
        velocity_mps=np.where(unseen[..., None], np.float32(0), field.velocity_mps),
        valid=field.valid & ~unseen,
    )


def _came_from(
    field: FlowField, cells: NDArray[np.bool_], occupied: NDArray[np.bool_], elapsed_s: float
) -> NDArray[np.bool_]:
    """(C,) whether something stood near the earlier place of each chosen cell (H, W)."""
    velocity_mps, grid = field.velocity_mps[cells], field.grid
    rows, cols, inside = grid.cells(grid.centres_m()[cells] - velocity_mps * elapsed_s)
    moved = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1]) * elapsed_s > grid.cell_m
    reach = int(np.ceil(_NEAR_M / grid.cell_m))
    near = np.zeros(len(rows), np.bool_)
    for down, right in np.ndindex(2 * reach + 1, 2 * reach + 1):
        row = np.clip(rows + down - reach, 0, grid.shape[0] - 1)
        col = np.clip(cols + right - reach, 0, grid.shape[1] - 1)
        near |= occupied[row, col]
    return np.asarray(near & inside & moved)


def _moved(sweep: Sweep, correction: Pose) -> Sweep:
    """The sweep with its points and its optical centre moved within the same ego frame."""
    return replace(
        sweep,
        xyz_m=correction.apply(sweep.xyz_m).astype(np.float32),
        origin_m=correction.apply(sweep.origin_m[None])[0],
    )
