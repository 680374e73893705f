"""No flow: the baseline that measures nothing."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.flow.sweep_pair import GroundStage, elapsed_seconds, obstacle_points, unmeasured


class ZeroConfig(StrictModel):
    """Settings: which points occupy a cell."""

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

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Return the occupied cells of ``current``, none of them valid.

        Raises:
            InputError: the sweeps are not in order of time.
        """
        elapsed_seconds(past, current)
        obstacles, _ = obstacle_points(current, self._ground)
        return unmeasured(self.grid, obstacles)
