"""Held-out pairs of the embedded world with the true velocity of every occupied cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.core.tables import FlowSamples
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset, SyntheticScene
from mottrack.flow.sweep_pair.obstacle_points import GroundStage, keep_points
from mottrack.world import PointTruth

SEED = 770_001
"""No training set uses it."""
INDEX = 5
MOVING_MPS = 0.5
FEWEST_POINTS = 5


@dataclass(frozen=True)
class HeldOut:
    """One pair, its frames and its truth on the grid."""

    frames: tuple[Frame, Frame]
    previous: Sweep
    current: Sweep
    occupied: NDArray[np.bool_]
    """(H,W) cells with a point above the ground."""
    velocity_mps: NDArray[np.float32]
    """(H,W,2) mean over the points of a cell."""
    observable: NDArray[np.bool_]
    """(H,W) the object was hit at least five times in both sweeps (background: always)."""

    def samples(self, field: FlowField, index: int) -> FlowSamples:
        """What a source said of every occupied cell."""
        rows, columns = np.nonzero(self.occupied)
        truth = self.velocity_mps[rows, columns]
        elapsed_s = seconds_between(self.previous.stamp_ns, self.current.stamp_ns)
        valid = field.valid[rows, columns]
        estimate = np.where(valid[:, None], field.velocity_mps[rows, columns], 0.0)
        return FlowSamples(
            frame=np.full(len(rows), index),
            xy_m=field.grid.centres_m()[rows, columns].astype(np.float32),
            estimate_mps=estimate.astype(np.float32),
            truth_mps=truth,
            dt_s=np.full(len(rows), elapsed_s, np.float32),
            valid=valid,
            dynamic=np.hypot(truth[:, 0], truth[:, 1]) > MOVING_MPS,
            observable=self.observable[rows, columns],
        )


def held_out_pairs(count: int, grid: BevGrid) -> Iterator[HeldOut]:
    """One pair from each of `count` scenes, every scene with a sensor and a place of its own."""
    config = SyntheticConfig(scenes=count, seed=SEED, duration_s=1.0, sensor="random")
    dataset = SyntheticDataset(config)
    for name in dataset.scene_names:
        yield held_out_pair(dataset.scene(name), INDEX, grid)


def held_out_pair(scene: SyntheticScene, index: int, grid: BevGrid) -> HeldOut:
    """The sweep at `index` of a scene and the one before it."""
    truths = scene.sweep_truth(index - 1), scene.sweep_truth(index)
    sweeps = scene.sweep(index - 1), scene.sweep(index)
    frames = scene.frame(index - 1), scene.frame(index)
    return _held_out(frames, sweeps, truths, grid)


def _held_out(
    frames: tuple[Frame, Frame],
    sweeps: tuple[Sweep, Sweep],
    truths: tuple[PointTruth, PointTruth],
    grid: BevGrid,
) -> HeldOut:
    kept = [_kept_rows(sweep) for sweep in sweeps]
    now = truths[1]
    rows, columns, inside = grid.cells(sweeps[1].xyz_m[kept[1]])
    flat = (rows * grid.shape[1] + columns)[inside]
    of_cell = kept[1][inside]
    seen = observable_points(truths[0].object_id[kept[0]], now.object_id[of_cell])
    points = np.maximum(np.bincount(flat, minlength=grid.shape[0] * grid.shape[1]), 1)

    def mean(values: NDArray[np.floating]) -> NDArray[np.float32]:
        sums = np.bincount(flat, weights=values, minlength=len(points)) / points
        return sums.reshape(grid.shape).astype(np.float32)

    velocity = now.velocity_mps[of_cell]
    return HeldOut(
        frames=frames,
        previous=sweeps[0],
        current=sweeps[1],
        occupied=grid.occupancy(sweeps[1].xyz_m[kept[1]]),
        velocity_mps=np.stack([mean(velocity[:, i]) for i in range(2)], axis=-1),
        observable=mean(seen.astype(np.float32)) > 0.5,
    )


def observable_points(then: NDArray[np.int64], now: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N,) whether the object of each current point was hit often enough in both sweeps."""
    both = [np.unique(ids[ids >= 0], return_counts=True) for ids in (then, now)]
    often = [ids[counts >= FEWEST_POINTS] for ids, counts in both]
    return (now < 0) | (np.isin(now, often[0]) & np.isin(now, often[1]))


def _kept_rows(sweep: Sweep) -> NDArray[np.int64]:
    """Rows of the points above the ground."""
    numbered = Sweep(
        sweep.xyz_m,
        sweep.reflectance,
        sweep.stamp_ns,
        sweep.world_T_ego,
        sweep.origin_m,
        time_offset_ns=np.arange(len(sweep), dtype=np.int64),
    )
    kept, _ = keep_points(numbered, GroundStage())
    if kept.time_offset_ns is None:
        return np.zeros(0, np.int64)
    return kept.time_offset_ns
