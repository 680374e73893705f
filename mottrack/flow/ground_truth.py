"""Flow from annotated tracks: the paper's training target (section III-C) and the upper bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.objects import Truth
from mottrack.core.pose import rotation_2d
from mottrack.core.sweep import Sweep
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.flow.sweep_pair import (
    GroundStage,
    elapsed_seconds,
    flow_field,
    obstacle_points,
    unmeasured,
)
from mottrack.lidar.in_boxes import points_in_boxes

RIM_M = 1.5
"""A cell of the background this near to a moving box may hold its points: labels are tight, and
its shadow moves with it. No figure of static cells counts it."""


class GroundTruthConfig(StrictModel):
    """How annotated tracks become a field."""

    ground: GroundStage = Field(default_factory=GroundStage)
    margin_m: float = Field(0.15, ge=0, description="boxes grow by this on each side")
    static_below_mps: float = Field(
        0.2, ge=0, description="a labelled object slower than this is static: label noise"
    )
    sigma_mps: float = Field(0.1, gt=0, description="standard deviation of the field's error")


class GroundTruthFlow(FlowSourceBase):
    """Velocity of each labelled object at the current stamp, as the data set gives or fits it.

    "Only labeled dynamic objects can have a valid velocity, and all non-labeled obstacles and
    background should have zero velocity" (section III-C): the other occupied cells are zero and
    valid. Cells of an object whose velocity the labels do not give are occupied and not valid.
    """

    Config = GroundTruthConfig
    error_model = NO_OUTLIERS

    def __init__(
        self, config: GroundTruthConfig | None = None, *, grid: BevGrid | None = None
    ) -> None:
        self.config = config or GroundTruthConfig()
        self.grid = grid or BevGrid()
        self._ground = self.config.ground.reaching(self.grid)
        self._truth: Truth | None = None

    def observe(self, frame: Frame) -> None:
        """Store the truth of a frame, if it has one."""
        self._truth = frame.truth

    def reset(self) -> None:
        """Remove the stored truth at the start of a scene."""
        self._truth = None

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Return the field of the truth observed last; without truth no cell is valid.

        Raises:
            InputError: the sweeps are not in order of time.
        """
        elapsed_seconds(past, current)
        obstacles, _ = obstacle_points(current, self._ground)
        truth = self._truth
        if truth is None or truth.stamp_ns != current.stamp_ns:
            return unmeasured(self.grid, obstacles)
        world_mps, known = self._velocities(truth)
        ego_T_world = current.world_T_ego.inverse()
        object_of = self._cells(truth.transformed(ego_T_world, "ego"), obstacles)
        # the last row is picked by -1: background, static, known
        velocity_mps = np.vstack([world_mps @ rotation_2d(ego_T_world.yaw_rad).T, np.zeros(2)])
        valid = np.append(known, True)[object_of]
        variance = self.config.sigma_mps**2
        return flow_field(self.grid, obstacles, velocity_mps[object_of], valid, variance)

    def _velocities(self, truth: Truth) -> tuple[F64, Mask]:
        """Return world velocities (N, 2), zero where slow or unknown, and a mask of the known."""
        known = np.asarray(np.isfinite(truth.velocity_mps).all(axis=1))
        velocity_mps = np.where(known[:, None], truth.velocity_mps, 0.0)
        slow = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1]) < self.config.static_below_mps
        velocity_mps[slow] = 0.0
        return velocity_mps, known

    def _cells(self, truth: Truth, obstacles: Sweep) -> I64:
        """Return (H, W) the object of each cell, -1 for none; boxes in the ego frame."""
        inside = points_in_boxes(
            obstacles.xyz_m, truth.centre_m, truth.size_m, truth.yaw_rad, self.config.margin_m
        )
        object_of = inside.first_box(len(obstacles))
        cells = np.full(self.grid.shape, -1, np.int64)
        rows, cols, in_grid = self.grid.cells(obstacles.xyz_m)
        on_object = in_grid & (object_of >= 0)
        cells[rows[on_object], cols[on_object]] = object_of[on_object]
        return cells
