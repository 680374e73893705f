"""Flow without boxes and without learning: connected components, registered from many starts.

The non-ground points of the current sweep fall into connected components. Each is registered to
the previous sweep from rest and from the best displacements of a correlation of occupancy, and
believed to move only where its shift explains clearly more, in both directions, than rest: what
one sweep could not see is no evidence. Small pieces without a motion of their own follow a moving
neighbour if that explains them better.
"""

from __future__ import annotations

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep
from mottrack.flow.registration.component_field import component_field
from mottrack.flow.registration.components import connected_cells
from mottrack.flow.registration.fragments import follow_neighbours
from mottrack.flow.registration.matcher import Labels, MatchConfig, Matcher
from mottrack.flow.registration.motion_test import MotionDecision, MotionTestConfig, is_moving
from mottrack.flow.shipped_errors import shipped_errors
from mottrack.flow.stages import Stages, StagesConfig, VisibilityStage


class ClusterIcpConfig(StrictModel):
    """How sweeps are prepared, components made, registered and judged."""

    stages: StagesConfig = Field(
        default_factory=lambda: StagesConfig(visibility=VisibilityStage(enabled=False))
    )
    match: MatchConfig = Field(default_factory=MatchConfig)
    verdict: MotionTestConfig = Field(default_factory=MotionTestConfig)
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
        """Forgets the work on earlier sweeps."""
        self._stages.forget()

    def estimate(self, previous: Sweep, current: Sweep) -> FlowField:
        """The field of every component that could be compared.

        Raises:
            InputError: ``current`` is not later than ``previous``.
        """
        prepared = self._stages.before(previous, current)
        if len(prepared.previous) == 0 or len(prepared.current) == 0:
            occupied = self.grid.occupancy(prepared.current.xyz_m)
            return FlowField.unmeasured(self.grid, occupied, current.stamp_ns)
        matcher = Matcher(prepared, self.config.match)
        labels = Labels(*connected_cells(matcher.points_m, matcher.raster, self.config.far_m))
        matches = matcher.match(labels)
        judged = MotionDecision(labels, matches, is_moving(matches, self.config.verdict))
        judged = follow_neighbours(matcher, judged, self.config.verdict)
        return component_field(self.grid, prepared, matcher, judged)
