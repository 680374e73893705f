"""No flow: the baseline that measures nothing."""

from __future__ import annotations

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.flow.sweep_pair.elapsed import elapsed_seconds
from mottrack.flow.sweep_pair.obstacle_points import GroundStage, keep_points


class ZeroConfig(StrictModel):
    """Only which points occupy a cell."""

    ground: GroundStage = Field(default_factory=GroundStage)


class ZeroFlow(FlowSourceBase):
    """Marks the occupied cells and measures no velocity: the tracker runs on positions alone."""

    Config = ZeroConfig
    needs_sweeps = False
    error_model = NO_OUTLIERS

    def __init__(self, config: ZeroConfig | None = None, *, grid: BevGrid | None = None) -> None:
        self.config = config or ZeroConfig()
        self.grid = grid or BevGrid()
        self._ground = self.config.ground.reaching(self.grid)

    def estimate(self, previous: Sweep, current: Sweep) -> FlowField:
        """The occupied cells of ``current``, none of them valid.

        Raises:
            InputError: ``current`` is not later than ``previous``.
        """
        elapsed_seconds(previous, current)
        kept, _ = keep_points(current, self._ground)
        return FlowField.unmeasured(self.grid, self.grid.occupancy(kept.xyz_m), current.stamp_ns)

    def reset(self) -> None:
        """Nothing to forget."""
