"""Flow source `dogma`: velocities from the dynamic occupancy grid map."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import Mask
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.core.velocity_errors import FLOW_ERRORS
from mottrack.flow.dogma.field import ObstaclePoints, ReadoutConfig, flow_field, is_moving
from mottrack.flow.dogma.filter import DynamicGridFilter, FilterConfig, GridMap
from mottrack.flow.dogma.measurement_grid import OBSTACLE, SensorConfig, measure, returns_of
from mottrack.flow.dogma.predict import REFERENCE_PERIOD_S
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Workers
from mottrack.flow.sweep_pair import GroundStage, elapsed_seconds

REMEDY = "call reset() between scenes, or set flow.continuity.on_jump=restart"


class ContinuityConfig(StrictModel):
    """What still counts as the same scene."""

    longest_gap_s: float = Field(1.0, gt=0, description="longest time between two sweeps")
    fastest_ego_mps: float = Field(80.0, gt=0, description="a faster ego vehicle has jumped")
    on_jump: Literal["refuse", "restart"] = Field(
        "refuse", description="whether a jump is an error or begins a new map"
    )


class DogmaConfig(StrictModel):
    """Settings of every stage; the defaults are for 10 Hz sweeps and 0.25 m cells."""

    ground: GroundStage = GroundStage()
    sensor: SensorConfig = SensorConfig()
    filter: FilterConfig = FilterConfig()
    readout: ReadoutConfig = ReadoutConfig()
    continuity: ContinuityConfig = ContinuityConfig()
    threads: int = Field(4, ge=1, description="threads, at most; the result is the same")


class DogmaFlow(FlowSourceBase):
    """Recursive flow, unlike that from two sweeps: a particle filter over a whole scene."""

    Config = DogmaConfig
    error_model = replace(FLOW_ERRORS, relative=0.0)
    """Its covariance has the relative part in it (`ReadoutConfig.relative`)."""
    stateful = True
    """Each estimate builds on all sweeps before it."""

    def __init__(self, config: DogmaConfig | None = None, *, grid: BevGrid | None = None) -> None:
        self.config = config or DogmaConfig()
        self.grid = grid or BevGrid()
        self._ground = self.config.ground.reaching(self.grid)
        self._workers = Workers(min(self.config.threads, os.cpu_count() or 1))
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

    def estimate(self, previous: Sweep, current: Sweep) -> FlowField:
        """Return the field at `current`, after all sweeps given since `reset`.

        The filter is updated with those of the two sweeps that it has not had yet, so a scene may
        be given as overlapping pairs.

        Raises:
            InputError: `current` is not later than `previous` and than every sweep before, or
                time or the ego vehicle jumps by more than `continuity` allows.
        """
        elapsed_seconds(previous, current)
        if self._last is None or previous.stamp_ns > self._last.stamp_ns:
            self._update(previous)
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
        """Return the seconds since the last sweep; the reference period at the start of a scene.

        Raises:
            InputError: time or the ego vehicle jumps and jumps are refused; nothing has changed.
        """
        if self._last is None:
            return REFERENCE_PERIOD_S
        elapsed_s = seconds_between(self._last.stamp_ns, sweep.stamp_ns)
        problem = self._jump(self._last, sweep, elapsed_s)
        if problem is None:
            return elapsed_s
        if self.config.continuity.on_jump == "refuse":
            raise problem
        self.reset()
        return REFERENCE_PERIOD_S

    def _jump(self, last: Sweep, sweep: Sweep, elapsed_s: float) -> InputError | None:
        """Return why the sweep cannot continue the map, if it cannot."""
        continuity = self.config.continuity
        if elapsed_s <= 0:
            return InputError("stamp_ns", sweep.stamp_ns, f"> {last.stamp_ns}, the last sweep's")
        if elapsed_s > continuity.longest_gap_s:
            expected = f"<= {continuity.longest_gap_s} s ({REMEDY})"
            return InputError("time since the last sweep", f"{elapsed_s:.3f} s", expected)
        moved_m = sweep.world_T_ego.translation_m - last.world_T_ego.translation_m
        speed_mps = float(np.linalg.norm(moved_m)) / elapsed_s
        if speed_mps > continuity.fastest_ego_mps:
            expected = f"<= {continuity.fastest_ego_mps} m/s ({REMEDY})"
            return InputError("speed of the ego vehicle", f"{speed_mps:.1f} m/s", expected)
        return None
