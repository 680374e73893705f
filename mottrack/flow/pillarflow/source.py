"""PillarFlow and its binary baseline as flow sources."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, Mask
from mottrack.core.errors import DataError
from mottrack.core.grid import WHOLE_CELLS, BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep, has_jumped, seconds_between
from mottrack.flow.pillarflow.forked import require_threads
from mottrack.flow.pillarflow.pillars import cell_of_centres, network_points, visibility_shares
from mottrack.flow.pillarflow.sight import SHARES, point_sight, sight_image
from mottrack.flow.shipped_errors import errors_file, weights_errors
from mottrack.flow.stages import Stages, StagesConfig
from mottrack.flow.sweep_pair import PastSweep, SweepPair, elapsed_seconds, unmeasured

if TYPE_CHECKING:
    from mottrack.flow.pillarflow.engine import CellMotion, EngineInput, OlderPoints

AGE_SLACK_S = 0.12
"""Networks are trained with older sweeps whose ages differ by 0.1 s and a little."""
SHIPPED = Path(__file__).parent / "weights"
"""Folder of the weights that come with the package."""


_PAST_SWEEPS = 5
"""Every tenth of the half second of `history_s`: one of them is near `baseline_s`, and the oldest
is what the refinement registers to beside it."""


def weights_path(name: str) -> Path:
    """Return the file of shipped weights, or `name` itself if it is a .safetensors file.

    Raises:
        DataError: no weights of that name are shipped.
    """
    if name.endswith(".safetensors"):
        return Path(name)
    file = SHIPPED / f"{name}.safetensors"
    if not file.exists():
        shipped = sorted(path.stem for path in SHIPPED.glob("*.safetensors"))
        raise DataError(file, "weights", "absent", f"one of {shipped} or a .safetensors file")
    return file


class PillarFlowConfig(StrictModel):
    """Weights, device, and the stages around the network."""

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
    sweeps: Literal[2] | None = Field(
        None, description="sweeps that the network takes; null: as many as its weights do"
    )
    margin_m: float = Field(
        4.0,
        ge=0,
        le=20,
        description="the network sees so much more on every side than the grid of its field: what"
        " enters within the interval",
    )
    baseline_s: float = Field(
        0.2,
        gt=0,
        le=0.5,
        description="wanted age of the earlier sweep of the network's pair",
    )
    slow_ego_mps: float = Field(
        10.0,
        ge=0,
        description="for a faster vehicle it is the newest one: fast traffic leaves the reach",
    )
    max_gap_s: float = Field(0.5, gt=0, description="over a longer gap no cell is valid")
    max_sigma_mps: float = Field(10.0, gt=0, description="a less certain cell is not valid")

    def files(self) -> tuple[Path, ...]:
        """Return the weights' file and, where there is one, that of their error model.

        Raises:
            DataError: none of that name are shipped.
        """
        weights = weights_path(self.weights)
        return tuple(f for f in (weights, errors_file(weights)) if f == weights or f.is_file())


class BinaryOgmConfig(PillarFlowConfig):
    """The same with the weights of the binary occupancy network (section IV-C)."""

    weights: str = Field("binary_ogm", description="shipped weights by name, or a file")


class PillarFlow(FlowSourceBase):
    """Estimates a dense field of velocities with a learned network.

    `raw` is the network alone; `estimate` applies the stages before it and, if `refined`, after it.
    """

    Config: type[PillarFlowConfig] = PillarFlowConfig

    def __init__(
        self, config: PillarFlowConfig | None = None, *, grid: BevGrid | None = None
    ) -> None:
        """Load the weights.

        Raises:
            DataError: they are absent or unusable.
            ConfigError: a GPU is asked for and there is none.
        """
        # torch takes seconds to import: only who makes a source waits for it
        from mottrack.flow.pillarflow.engine import make_engine, use_threads
        from mottrack.flow.pillarflow.weights_file import load_weights

        self.config = config or self.Config()
        self.grid = grid or BevGrid()
        self.errors_name = self.config.weights + ("" if self.config.refined else "_raw")
        self.error_model = weights_errors(self.config.weights, refined=self.config.refined)
        weights = load_weights(weights_path(self.config.weights))
        self.network = weights.network.config
        self.several = self.config.sweeps != 2
        self.past_sweeps = _PAST_SWEEPS
        wide = widened(self.grid, self.config.margin_m)
        stages = self.config.stages
        ground = stages.ground.reaching(wide)
        self.stages = Stages(stages.model_copy(update={"ground": ground}), self.grid)
        self.cells = weights.network.cells(wide)
        self._index = cell_of_centres(self.grid, self.cells)
        use_threads(self.config.threads)
        self._engine = make_engine(
            weights, device=self.config.device, precision=self.config.precision
        )

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Estimate the field at `current`.

        Over a gap longer than `max_gap_s`, or where the pose jumped, no cell is valid.

        Raises:
            InputError: the sweeps are not in order of time.
        """
        elapsed_seconds(past, current)
        past = self.in_use(past, current)
        gap_s = elapsed_seconds(past, current)
        if gap_s > self.config.max_gap_s or has_jumped(past[-1], current):
            return unmeasured(self.grid, self.stages.features_of(current).obstacles[0])
        pair = self.stages.before(past, current)
        field = self.raw(pair)
        return self.stages.after(field, pair) if self.config.refined else field

    def in_use(self, past: Sequence[Sweep], current: Sweep) -> list[Sweep]:
        """Return the past sweeps that the network and the refinement use, from the oldest on.

        The network compares with the one whose age is nearest to `baseline_s`: over 0.2 s a slow
        object moves twice as many cells as over 0.1 s. On a motorway it compares with the newest:
        over 0.2 s it reads vehicles of 20 to 30 m/s at rest. Of the older ones those are in use
        that it takes, and the oldest if the refinement follows.
        """
        ages_s = [seconds_between(sweep.stamp_ns, current.stamp_ns) for sweep in past]
        moved_m = current.world_T_ego.translation_m - past[-1].world_T_ego.translation_m
        fast = np.hypot(moved_m[0], moved_m[1]) > self.config.slow_ego_mps * ages_s[-1]
        wanted_s = 0.0 if fast else self.config.baseline_s
        wanted = int(np.argmin(np.abs(np.array(ages_s) - wanted_s)))
        used = {wanted, *(i for i in self._older(ages_s[:wanted]) if i is not None)}
        if self.config.refined:
            used.add(0)
        return [past[i] for i in sorted(used)]

    def _older(self, ages_s: Sequence[float]) -> list[int | None]:
        """Return the index of the sweep for each of the network's older ones, by their ages.

        None where there is none within `AGE_SLACK_S`.
        """
        wanted_s = self.network.older_ages_s if self.several else ()
        left, chosen = list(range(len(ages_s))), list[int | None]()
        for age_s in reversed(wanted_s):  # the oldest have the fewest sweeps to choose from
            near = [i for i in left if abs(ages_s[i] - age_s) <= AGE_SLACK_S]
            chosen.append(min(near, key=lambda i: abs(ages_s[i] - age_s), default=None))
            left = [i for i in left if i != chosen[-1]]
        return chosen[::-1]

    def _older_points(self, pair: SweepPair) -> tuple[OlderPoints, ...]:
        """Return the older sweeps that the network takes; empty where none is there.

        One that is not there is without points and has the ratio 0.
        """
        from mottrack.flow.pillarflow.engine import OlderPoints

        indices = self._older([one.elapsed_s for one in pair.past[:-1]])
        chosen = [None if i is None else pair.past[i] for i in indices]
        if not any(chosen):
            return ()
        nothing = OlderPoints(np.zeros((0, 4), np.float32), 0.0)
        return tuple(
            nothing if one is None else OlderPoints(points_of(one), pair.elapsed_s / one.elapsed_s)
            for one in chosen
        )

    def raw(self, pair: SweepPair) -> FlowField:
        """Run the network alone; nothing is valid if either sweep is empty.

        Raises:
            ConfigError: the process was forked from one that had run the network.
        """
        previous, current = pair.previous, pair.current
        occupied = self.grid.occupancy(current.xyz_m)
        if not len(previous) or not occupied.any():
            return FlowField.unmeasured(self.grid, occupied, current.stamp_ns)
        require_threads()
        return self._field(self._engine.run(self.engine_input(pair), self.cells), occupied, pair)

    def engine_input(self, pair: SweepPair) -> EngineInput:
        """Return what the network is given of a pair and the sweeps before it."""
        from mottrack.flow.pillarflow.engine import EngineInput

        now = network_points(pair.current.xyz_m, pair.current_height_m, pair.current.reflectance)
        then = points_of(pair.past[-1])
        visible = visibility_shares(pair.current_seen, pair.previous_seen, self._index, self.cells)
        sight = np.zeros_like(visible)
        if self.network.sight:
            states = point_sight(pair)
            sight[:SHARES] = sight_image(now, states.current, self.cells)
            sight[SHARES:] = sight_image(then, states.previous, self.cells)
        shares = np.concatenate((visible, sight))
        return EngineInput(now, then, shares, self._older_points(pair))

    def reset(self) -> None:
        """Remove the features of earlier sweeps."""
        self.stages.reset()

    def _field(self, motion: CellMotion, occupied: Mask, pair: SweepPair) -> FlowField:
        """Look up the network's cell for each occupied cell and divide by the elapsed time."""
        rows, columns = np.divmod(self._index[occupied], self.cells.columns)
        rows, columns = rows // motion.stride, columns // motion.stride
        covariance = np.zeros((*occupied.shape, 2, 2), np.float32)
        velocity = np.zeros((*occupied.shape, 2), np.float32)
        covariance[occupied] = motion.covariance_m2[rows, columns] / pair.elapsed_s**2
        velocity[occupied] = motion.motion_m[rows, columns] / pair.elapsed_s
        variance = covariance[..., 0, 0] + covariance[..., 1, 1]
        return FlowField(
            grid=self.grid,
            velocity_mps=velocity,
            covariance_m2ps2=covariance,
            occupied=occupied,
            valid=occupied & (variance < 2.0 * self.config.max_sigma_mps**2),
            weight=occupied.astype(np.float32),
            stamp_ns=pair.current.stamp_ns,
        )


def widened(grid: BevGrid, margin_m: float) -> BevGrid:
    """Return a grid of the same cells that reaches further by at least `margin_m` on each side."""
    more_m = math.ceil(margin_m / grid.cell_m - WHOLE_CELLS) * grid.cell_m
    return BevGrid(
        grid.x_min_m - more_m,
        grid.x_max_m + more_m,
        grid.y_min_m - more_m,
        grid.y_max_m + more_m,
        grid.cell_m,
    )


def points_of(sweep: PastSweep) -> F32:
    """Return the points (N,4) of a past sweep, as the network takes them."""
    points = sweep.obstacles
    return network_points(points.xyz_m, sweep.height_m, points.reflectance)


class BinaryOgmFlow(PillarFlow):
    """The one-channel network on binary occupancy (section IV-C)."""

    Config = BinaryOgmConfig
