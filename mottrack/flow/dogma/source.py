"""Flow source `dogma`: velocities from the dynamic occupancy grid map."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import Mask
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.processes import available_cores
from mottrack.core.sweep import Sweep, has_jumped, seconds_between
from mottrack.flow.dogma.field import ObstaclePoints, ReadoutConfig, flow_field, is_moving
from mottrack.flow.dogma.filter import DynamicGridFilter, FilterConfig, GridMap
from mottrack.flow.dogma.measurement_grid import OBSTACLE, SensorConfig, measure, returns_of
from mottrack.flow.dogma.predict import REFERENCE_PERIOD_S
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Workers
from mottrack.flow.shipped_errors import shipped_errors
from mottrack.flow.sweep_pair import GroundStage, elapsed_seconds


class DogmaConfig(StrictModel):
    """Settings of every stage; the defaults are for 10 Hz sweeps and 0.25 m cells."""

    ground: GroundStage = GroundStage()
    sensor: SensorConfig = SensorConfig()
    filter: FilterConfig = FilterConfig()
    readout: ReadoutConfig = ReadoutConfig()
    longest_gap_s: float = Field(
        1.0, gt=0, description="after a longer time without a sweep the map is begun anew"
    )
    threads: int = Field(4, ge=1, description="threads, at most; the result is the same")


class DogmaFlow(FlowSourceBase):
    """Recursive flow, unlike that from two sweeps: a particle filter over a whole scene."""

    Config = DogmaConfig
    error_model = shipped_errors("dogma")
    stateful = True
    """Each estimate builds on all sweeps before it."""

    def __init__(self, config: DogmaConfig | None = None, *, grid: BevGrid | None = None) -> None:
        self.config = config or DogmaConfig()
        self.grid = grid or BevGrid()
        self._ground = self.config.ground.reaching(self.grid)
        self._workers = Workers(min(self.config.threads, available_cores()))
        self.reset()

    def reset(self) -> None:
        """Clear the map at the start of a scene."""
        self._filter = DynamicGridFilter(self.config.filter, self._workers)
        self._last: Sweep | None = None
        self._map: GridMap | None = None

    @property
    def grid_map(self) -> GridMap | None:
        """The map after the last sweep, in world axes; None before the first."""
        return self._map

    def current_map(self) -> tuple[GridMap, Mask]:
        """Return `grid_map`, and (rows, cols) which of its cells move by the Mahalanobis test.

        Raises:
            InputError: there has been no sweep since `reset`.
        """
        if self._map is None:
            raise InputError("sweeps since reset()", 0, "at least one")
        return self._map, is_moving(self._map, self.config.readout)

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Return the field at `current`, after all sweeps given since `reset`.

        The filter is updated with `current` and the newest of `past` if it has not had them yet,
        so a scene may be given as overlapping pairs.

        Raises:
            InputError: the sweeps, and every one before, are not in order of time.
        """
        elapsed_seconds(past, current)
        if self._last is None or past[-1].stamp_ns > self._last.stamp_ns:
            self._update(past[-1])
        return self._update(current)

    def _update(self, sweep: Sweep) -> FlowField:
        """Run one cycle: sweep -> returns -> measurement grid -> filter -> flow field."""
        dt_s = self._elapsed_s(sweep)
        returns = returns_of(sweep, self._ground)
        window = self._window(sweep)
        measured = measure(returns, window, self.config.sensor, self._workers)
        self._map = self._filter.step(measured, window, dt_s)
        self._last = sweep
        obstacle = returns.kind == OBSTACLE
        points = ObstaclePoints(
            ego_m=sweep.xyz_m[obstacle, :2],
            window_m=returns.xy_m[obstacle] + (returns.centre_m - window.corner_m),
        )
        return flow_field(self._map, points, self.grid, sweep, self.config.readout)

    def _window(self, sweep: Sweep) -> Window:
        """Return a square around the vehicle, up to the ego grid's farthest side."""
        cell_m = self.grid.cell_m
        x_m, y_m = sweep.world_T_ego.translation_m[:2]
        return Window.around(x_m, y_m, 2 * math.ceil(self.grid.reach_m / cell_m), cell_m)

    def _elapsed_s(self, sweep: Sweep) -> float:
        """Return the seconds since the last sweep; the reference period where the map is new.

        After a gap, or where the vehicle's pose jumped, the map is begun anew.

        Raises:
            InputError: the stamp is not later than the last sweep's; nothing has changed.
        """
        if self._last is None:
            return REFERENCE_PERIOD_S
        elapsed_s = seconds_between(self._last.stamp_ns, sweep.stamp_ns)
        if elapsed_s <= 0:
            raise InputError("stamp_ns", sweep.stamp_ns, f"> {self._last.stamp_ns}, the last one's")
        if elapsed_s <= self.config.longest_gap_s and not has_jumped(self._last, sweep):
            return elapsed_s
        self.reset()
        return REFERENCE_PERIOD_S
