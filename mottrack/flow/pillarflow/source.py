"""PillarFlow and its binary rival as flow sources."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import Mask
from mottrack.core.errors import ConfigError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep
from mottrack.core.velocity_errors import FLOW_ERRORS
from mottrack.flow.pillarflow.raster import (
    cell_of_centres,
    network_cells,
    network_points,
    seen_shares,
)
from mottrack.flow.pillarflow.shipped import weights_path
from mottrack.flow.stages import Stages, StagesConfig
from mottrack.flow.sweep_pair import SweepPair, elapsed_seconds

if TYPE_CHECKING:
    from mottrack.flow.pillarflow.inference.engine import Engine, Motion
    from mottrack.flow.pillarflow.weights_file import Weights


class PillarFlowConfig(StrictModel):
    """Which weights, where they run, and the stages around them."""

    weights: str = Field("base", description="shipped weights by name, or a .safetensors file")
    device: Literal["auto", "cpu", "cuda"] = Field(
        "auto", description="auto: a GPU if there is one"
    )
    precision: Literal["auto", "fp32", "bf16"] = Field(
        "auto", description="of a CPU's convolutions; auto: bfloat16 where it has such units"
    )
    threads: int = Field(0, ge=0, description="CPU threads; 0: as the process is set")
    stages: StagesConfig = Field(default_factory=StagesConfig)
    refined: bool = Field(True, description="apply the stages after the network; off: raw network")
    max_gap_s: float = Field(0.5, gt=0, description="over a longer gap nothing is measured")
    max_sigma_mps: float = Field(10.0, gt=0, description="a less certain cell is not valid")

    def files(self) -> tuple[Path, ...]:
        """The weights; raises DataError if none of that name are shipped."""
        return (weights_path(self.weights),)


class BinaryOgmConfig(PillarFlowConfig):
    """The same with the weights of the binary occupancy network (section IV-C)."""

    weights: str = Field("binary_ogm", description="shipped weights by name, or a file")


class PillarFlow:
    """Estimates a dense field of velocities with a learned network.

    The raw network is `raw`; `estimate` applies the stages before it and, if `refined`, after it.
    """

    Config: type[PillarFlowConfig] = PillarFlowConfig
    stateful = False
    needs_sweeps = True
    error_model = FLOW_ERRORS

    def __init__(
        self, config: PillarFlowConfig | None = None, *, grid: BevGrid | None = None
    ) -> None:
        """Loads the weights.

        Raises:
            DataError: they are absent or unusable.
            ConfigError: a GPU is asked for and there is none.
        """
        from mottrack.flow.pillarflow.weights_file import load_weights

        self.config = config or self.Config()
        self.grid = grid or BevGrid()
        self.stages = Stages(self.config.stages, self.grid)
        weights = load_weights(weights_path(self.config.weights))
        shape = weights.network.config
        self.cells = network_cells(self.grid, shape.cell_m, shape.multiple)
        self._index = cell_of_centres(self.grid, self.cells)
        self._engine = _engine(weights, self.config)

    def estimate(self, previous: Sweep, current: Sweep) -> FlowField:
        """The field at `current`; over a gap longer than `max_gap_s` no cell is valid.

        Raises:
            InputError: ``current`` is not later than ``previous``.
        """
        if elapsed_seconds(previous, current) > self.config.max_gap_s:
            kept, _ = self.stages.features_of(current).obstacles
            occupied = self.grid.occupancy(kept.xyz_m)
            return FlowField.unmeasured(self.grid, occupied, current.stamp_ns)
        prepared = self.stages.before(previous, current)
        field = self.raw(prepared)
        return self.stages.after(field, prepared) if self.config.refined else field

    def raw(self, prepared: SweepPair) -> FlowField:
        """The network alone, on a prepared pair; nothing is valid if either sweep is empty."""
        occupied = self.grid.occupancy(prepared.current.xyz_m)
        stamp_ns = prepared.current.stamp_ns
        if not len(prepared.previous) or not occupied.any():
            return FlowField.unmeasured(self.grid, occupied, stamp_ns)
        then, now = prepared.previous, prepared.current
        seen = (prepared.current_seen, prepared.previous_seen)
        motion = self._engine.run(
            network_points(then.xyz_m, prepared.previous_height_m, then.reflectance),
            network_points(now.xyz_m, prepared.current_height_m, now.reflectance),
            seen_shares(seen, self._index, self.cells),
            self.cells,
        )
        return self._field(motion, occupied, prepared)

    def reset(self) -> None:
        """Forgets the work on earlier sweeps."""
        self.stages.reset()

    def _field(self, motion: Motion, occupied: Mask, prepared: SweepPair) -> FlowField:
        """The network's cells looked up for each occupied cell, divided by the elapsed time."""
        rows, columns = np.divmod(self._index[occupied], self.cells.columns)
        rows, columns = rows // motion.stride, columns // motion.stride
        covariance = np.zeros((*occupied.shape, 2, 2), np.float32)
        velocity = np.zeros((*occupied.shape, 2), np.float32)
        covariance[occupied] = motion.covariance_m2[rows, columns] / prepared.elapsed_s**2
        velocity[occupied] = motion.motion_m[rows, columns] / prepared.elapsed_s
        variance = covariance[..., 0, 0] + covariance[..., 1, 1]
        return FlowField(
            grid=self.grid,
            velocity_mps=velocity,
            covariance_m2ps2=covariance,
            occupied=occupied,
            valid=occupied & (variance < 2.0 * self.config.max_sigma_mps**2),
            weight=occupied.astype(np.float32),
            stamp_ns=prepared.current.stamp_ns,
        )


class BinaryOgmFlow(PillarFlow):
    """The one-channel network on binary occupancy (section IV-C)."""

    Config = BinaryOgmConfig


def _engine(weights: Weights, config: PillarFlowConfig) -> Engine:
    import torch

    from mottrack.flow.pillarflow.inference.cuda import CudaEngine
    from mottrack.flow.pillarflow.inference.engine import CpuEngine, has_bf16_units
    from mottrack.flow.pillarflow.threads import use_threads

    available = torch.cuda.is_available()
    if config.device == "cuda" and not available:
        raise ConfigError("flow.device is cuda, expected cpu or auto: torch finds no GPU")
    use_threads(config.threads)
    if available and config.device != "cpu":
        return CudaEngine(weights)
    half = config.precision == "bf16" or (config.precision == "auto" and has_bf16_units())
    return CpuEngine(weights, half=half)
