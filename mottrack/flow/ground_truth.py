"""Flow from annotated tracks: the paper's training target (section III-C) and the best case."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.objects import Truth
from mottrack.core.pose import Pose, rotation_2d
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.flow.sweep_pair.elapsed import elapsed_seconds
from mottrack.flow.sweep_pair.obstacle_points import GroundStage, keep_points
from mottrack.lidar.in_boxes import points_in_boxes

_REMEMBERED = 32
"""Truths kept: the previous sweep of a pair may be a few sweeps back."""


class GroundTruthConfig(StrictModel):
    """How annotated tracks become a field."""

    ground: GroundStage = Field(default_factory=GroundStage)
    margin_m: float = Field(0.15, ge=0, description="boxes grow by this on each side")
    static_below_mps: float = Field(
        0.2, ge=0, description="a labelled object slower than this stands still: label noise"
    )
    sigma_mps: float = Field(0.1, gt=0, description="standard deviation of the field's error")


class GroundTruthFlow(FlowSourceBase):
    """Velocity of each labelled object: the difference of its positions over the elapsed time.

    "Only labeled dynamic objects can have a valid velocity, and all non-labeled obstacles and
    background should have zero velocity" (section III-C): the other occupied cells are zero and
    valid. Cells of an object that was not annotated before are occupied and not valid.
    """

    Config = GroundTruthConfig
    error_model = NO_OUTLIERS

    def __init__(
        self, config: GroundTruthConfig | None = None, *, grid: BevGrid | None = None
    ) -> None:
        self.config = config or GroundTruthConfig()
        self.grid = grid or BevGrid()
        self._ground = self.config.ground.reaching(self.grid)
        self._truth: list[Truth] = []

    def observe(self, frame: Frame) -> None:
        """Remembers the truth of the latest frames that have one."""
        if frame.truth is not None:
            self._truth = [*self._truth, frame.truth][-_REMEMBERED:]

    def reset(self) -> None:
        """Forgets the truth: a new scene begins."""
        self._truth = []

    def estimate(self, previous: Sweep, current: Sweep) -> FlowField:
        """The field of the truth observed last; without truth no cell is valid.

        Raises:
            InputError: ``current`` is not later than ``previous``.
        """
        elapsed_seconds(previous, current)
        kept, _ = keep_points(current, self._ground)
        occupied = self.grid.occupancy(kept.xyz_m)
        if not self._truth or self._truth[-1].stamp_ns != current.stamp_ns:
            return FlowField.unmeasured(self.grid, occupied, current.stamp_ns)
        truth = self._truth[-1]
        velocity_mps, known = self._velocities(truth, previous.stamp_ns)
        ego_T_world = current.world_T_ego.inverse()
        cells = self._cells(truth.transformed(ego_T_world, "ego"), kept)
        return self._field(cells, occupied, (_turned(velocity_mps, ego_T_world), known), current)

    def _velocities(self, truth: Truth, previous_ns: int) -> tuple[F64, Mask]:
        """World velocity (N, 2) since the truth at or before `previous_ns`, and if it is known."""
        velocity_mps = np.zeros((len(truth), 2))
        known = np.zeros(len(truth), dtype=np.bool_)
        earlier = [t for t in self._truth[:-1] if t.stamp_ns <= previous_ns]
        if not earlier:
            return velocity_mps, known
        before = earlier[-1]
        elapsed_s = seconds_between(before.stamp_ns, truth.stamp_ns)
        _, now, then = np.intersect1d(truth.id, before.id, return_indices=True)
        shift_m = truth.centre_m[now, :2] - before.centre_m[then, :2]
        velocity_mps[now] = shift_m / elapsed_s
        known[now] = True
        slow = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1]) < self.config.static_below_mps
        velocity_mps[slow] = 0.0
        return velocity_mps, known

    def _cells(self, truth: Truth, kept: Sweep) -> I64:
        """(H, W) the object that each cell belongs to, -1 for none; boxes in the ego frame."""
        inside = points_in_boxes(
            kept.xyz_m, truth.centre_m, truth.size_m, truth.yaw_rad, self.config.margin_m
        )
        object_of = inside.first_box(len(kept))
        cells = np.full(self.grid.shape, -1, np.int64)
        rows, cols, in_grid = self.grid.cells(kept.xyz_m)
        on_object = in_grid & (object_of >= 0)
        cells[rows[on_object], cols[on_object]] = object_of[on_object]
        return cells

    def _field(
        self,
        object_of: I64,
        occupied: Mask,
        velocities: tuple[F64, Mask],
        current: Sweep,
    ) -> FlowField:
        velocity_mps, known = velocities
        # the last row stands for -1: background, at rest, known
        velocity_mps = np.vstack([velocity_mps, np.zeros((1, 2))])
        known = np.append(known, True)
        valid = occupied & known[object_of]
        variance = np.where(valid, self.config.sigma_mps**2, 0.0).astype(np.float32)
        return FlowField(
            grid=self.grid,
            velocity_mps=np.where(valid[..., None], velocity_mps[object_of], 0.0).astype(
                np.float32
            ),
            covariance_m2ps2=variance[..., None, None] * np.eye(2, dtype=np.float32),
            occupied=occupied,
            valid=valid,
            weight=occupied.astype(np.float32),
            stamp_ns=current.stamp_ns,
        )


def _turned(velocity_mps: F64, b_T_a: Pose) -> F64:
    turned: F64 = velocity_mps @ rotation_2d(b_T_a.yaw_rad).T
    return turned
