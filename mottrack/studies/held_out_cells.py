"""Flow of held-out pairs of the embedded world: resting cells by shadow share and by ego speed.

A surface that comes into view looks like motion, the more so the faster the vehicle drives. So the
cells at rest are sorted by the share of their points that the earlier sweep could not see, in three
dimensions, and by the speed of the vehicle. A cell that a source did not measure enters no error:
the share of measured cells stands beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, Self

import numpy as np
from scipy.ndimage import distance_transform_edt

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import ConfigError
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.motion import MOVING_MPS, FlowField
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.flow.ground_truth import RIM_M
from mottrack.flow.pillarflow.sight import TOLERANCE_M
from mottrack.flow.pillarflow.training.examples import LabelledPair
from mottrack.flow.sweep_pair import GroundStage, obstacle_points
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.lidar.visibility import UNSEEN, build_range_image, queried_from, states_of
from mottrack.studies.training_examples import world_pair

SEED = 950_001
"""Seed of the pairs: no training, no calibration and no table uses it."""
WORLD: dict[str, Any] = {
    "intervals_s": (0.1,),
    "older_ages_s": (0.2, 0.3, 0.4, 0.5),
    "older_spread_s": 0.0,
    "turning_share": 0.15,
    "motorway_share": 0.15,
    "lost_rings_share": 0.3,
}
"""Five past sweeps, as a run gives them at 10 Hz; drives and sensors as in the training recipes."""
SHADOW_AGE_S = 0.2
"""Age of the sweep whose shadows count: that to which the networks compare by default."""
SHADOW_EDGES = (0.0, 0.1, 0.3, 0.6, 1.0)
"""Of the shares of hidden points; in between few cells lie."""
EGO_EDGES_MPS = (0.0, 0.5, 5.0, 10.0, 20.0, np.inf)
"""At rest, manoeuvring, in town, on roads, on motorways."""
GROSS_MPS = 1.0
"""Walking pace: above it a resting cell is taken for something that moves."""


@dataclass(frozen=True)
class HeldOutCells:
    """C occupied cells whose points all move or all rest, with the estimates of one source."""

    error_mps: F64
    """(C,) length of the error; not a number where the source measured nothing."""
    moving: Mask
    """(C,) whether the truth is faster than `MOVING_MPS`."""
    hidden: F64
    """(C,) share of the cell's points that the earlier sweep could not see."""
    ego_mps: F64
    """(C,) speed of the vehicle."""

    @classmethod
    def of(cls, labelled: LabelledPair, field: FlowField) -> Self:
        """Compare a field with the truth of its pair.

        Left out are cells with points that move and points that rest, and cells at rest within
        `RIM_M` of moving points.
        """
        points = _ObstaclePoints.of(labelled, field.grid)
        moving = points.mean(points.moving)
        whole = field.occupied & (points.count > 0) & ((moving == 0) | (moving == 1))
        if (moving > 0).any():
            away_m = distance_transform_edt(moving == 0) * field.grid.cell_m
            whole &= (moving == 1) | (away_m > RIM_M)
        truth_mps = np.stack([points.mean(points.velocity_mps[:, i]) for i in range(2)], axis=-1)
        error_mps = np.linalg.norm(field.velocity_mps - truth_mps, axis=-1)
        error_mps[~field.valid] = np.nan
        return cls(
            error_mps[whole],
            moving[whole] == 1,
            points.mean(points.hidden)[whole],
            np.full(int(whole.sum()), ego_speed_mps(labelled)),
        )

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """Return the cells of several pairs."""
        columns = [f.name for f in fields(cls)]
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in columns))


@dataclass(frozen=True)
class _ObstaclePoints:
    """The obstacle points of a current sweep on a grid."""

    grid: BevGrid
    cell: I64
    """(N,) flat index."""
    velocity_mps: F64
    """(N, 2)"""
    moving: F64
    """(N,) 1 or 0."""
    hidden: F64
    """(N,) 1 where the earlier sweep could not see the place, else 0."""

    @classmethod
    def of(cls, labelled: LabelledPair, grid: BevGrid) -> Self:
        numbered = replace(
            labelled.current, time_offset_ns=np.arange(len(labelled.current)), ring=None
        )
        obstacles, _ = obstacle_points(numbered, GroundStage().reaching(grid))
        row, column, inside = grid.cells(obstacles.xyz_m)
        obstacles = obstacles.select(inside)
        number = np.asarray(obstacles.time_offset_ns)
        velocity_mps = labelled.labels.velocity_mps[number].astype(np.float64)
        return cls(
            grid,
            (row * grid.shape[1] + column)[inside],
            velocity_mps,
            (np.linalg.norm(velocity_mps, axis=1) > MOVING_MPS).astype(np.float64),
            _hidden(labelled, obstacles).astype(np.float64),
        )

    @property
    def count(self) -> I64:
        """(H, W) points of each cell."""
        size = self.grid.shape[0] * self.grid.shape[1]
        return np.bincount(self.cell, minlength=size).reshape(self.grid.shape)

    def mean(self, values: F64) -> F64:
        """Return (H, W) the mean of values (N,) in each cell, 0 where no point is."""
        total = np.bincount(self.cell, weights=values, minlength=self.count.size)
        return total.reshape(self.grid.shape) / np.maximum(self.count, 1)


def past_of(labelled: LabelledPair) -> list[Sweep]:
    """Return the past sweeps of a pair, from the oldest to the newest."""
    return [*labelled.older[::-1], labelled.previous]


def ego_speed_mps(labelled: LabelledPair) -> float:
    """Return the speed of the vehicle over all the time that its sweeps span."""
    first, last = past_of(labelled)[0], labelled.current
    way_m = last.world_T_ego.translation_m - first.world_T_ego.translation_m
    return float(np.hypot(way_m[0], way_m[1]) / seconds_between(first.stamp_ns, last.stamp_ns))


def _hidden(labelled: LabelledPair, points: Sweep) -> Mask:
    """Return (N,) which points the sweep of about `SHADOW_AGE_S` ago could not see."""
    stamp_ns = labelled.current.stamp_ns
    then = min(
        past_of(labelled), key=lambda s: abs(seconds_between(s.stamp_ns, stamp_ns) - SHADOW_AGE_S)
    )
    then_T_now = then.world_T_ego.inverse() @ labelled.current.world_T_ego
    image = queried_from(build_range_image(then.xyz_m, then.origin_m), then_T_now)
    return np.asarray(states_of(image, np.asarray(points.xyz_m), TOLERANCE_M) == UNSEEN)


def study_cells(
    sources: Mapping[str, FlowSource], pairs: int, on_pair: Callable[[int, int], None]
) -> dict[str, HeldOutCells]:
    """Run flow sources on held-out pairs and return their cells.

    Args:
        sources: by name.
        pairs: number of pairs, each a world, a drive and a sensor of its own.
        on_pair: is called with (done, total) after each pair.

    Raises:
        ConfigError: a source reads boxes, which these pairs do not have.
    """
    for name, source in sources.items():
        if isinstance(source, FrameObserver):
            raise ConfigError(f"flow {name} reads boxes, expected a source that needs sweeps alone")
    parts: dict[str, list[HeldOutCells]] = {name: [] for name in sources}
    for index in range(pairs):
        labelled = world_pair(SEED, index, WORLD)
        for name, source in sources.items():
            parts[name].append(HeldOutCells.of(labelled, estimated(source, labelled)))
        on_pair(index + 1, pairs)
    return {name: HeldOutCells.joined(own) for name, own in parts.items()}


def estimated(source: FlowSource, labelled: LabelledPair) -> FlowField:
    """Return a source's field of a pair; one that filters over time sees every sweep before."""
    source.reset()
    sweeps = [*past_of(labelled), labelled.current]
    last = len(sweeps) - 1
    for k in range(1 if source.stateful else last, last):
        source.estimate(sweeps[max(0, k - source.past_sweeps) : k], sweeps[k])
    return source.estimate(sweeps[max(0, last - source.past_sweeps) : last], sweeps[last])


def cells_table(name: str, cells: HeldOutCells) -> TextTable:
    """Return the errors of one source: moving cells, cells at rest, and those by group."""
    columns = [Column(text) for text in ("cells", "number", "measured %", "RMSE m/s")]
    return TextTable(
        f"held_out_cells_{name}",
        f"{name}: held-out pairs of the embedded world",
        (*columns, Column("over 1 m/s %")),
        tuple(_row(group, cells.error_mps[mask]) for group, mask in _groups(cells)),
        "Errors of measured cells alone. Hidden: share of a resting cell's points that the sweep "
        f"{SHADOW_AGE_S:g} s before could not see. Cells at the rim of movers are left out.",
    )


def _groups(cells: HeldOutCells) -> Iterator[tuple[str, Mask]]:
    rest = ~cells.moving
    yield "moving", cells.moving
    yield "at rest", rest
    yield "hidden 0", rest & (cells.hidden <= SHADOW_EDGES[0])
    for low, high in pairwise(SHADOW_EDGES):
        yield f"hidden {low:g} to {high:g}", rest & (cells.hidden > low) & (cells.hidden <= high)
    for low, high in pairwise(EGO_EDGES_MPS):
        text = f"ego {low:g} to {high:g} m/s" if np.isfinite(high) else f"ego over {low:g} m/s"
        yield text, rest & (cells.ego_mps >= low) & (cells.ego_mps < high)


def _row(name: str, error_mps: F64) -> tuple[Cell, ...]:
    measured = error_mps[np.isfinite(error_mps)]
    share = 100 * len(measured) / len(error_mps) if len(error_mps) else None
    if not len(measured):
        return name, len(error_mps), share, None, None
    rmse = float(np.sqrt(np.mean(measured**2)))
    return name, len(error_mps), share, rmse, float(100 * np.mean(measured > GROSS_MPS))
