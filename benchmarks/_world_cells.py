"""Held-out pairs of the embedded world with the true velocity of every occupied cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mottrack.core.arrays import F32, I64, Floats, Mask
from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.core.tables import FlowSamples
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset, SyntheticScene
from mottrack.flow.sweep_pair.obstacle_points import GroundStage, keep_points

SEED = 770_001
"""No training set uses it."""
INDEX = 5
"""Of the current sweep: half a second in, all agents have a sweep before."""
MOVING_MPS = 0.5
"""A faster cell is dynamic, as everywhere in the flow scores."""
MIN_POINTS = 5
"""Fewest points on an object in both sweeps for its motion to be observable."""


@dataclass(frozen=True)
class HeldOut:
    """One pair, its frames and its truth on the grid."""

    frames: tuple[Frame, Frame]
    previous: Sweep
    current: Sweep
    occupied: Mask
    """(H,W) cells with a point above the ground."""
    velocity_mps: F32
    """(H,W,2) mean over the points of a cell."""
    observable: Mask
    """(H,W) the object was hit at least five times in both sweeps (background: always)."""

    def samples(self, field: FlowField, index: int) -> FlowSamples:
        """Return the estimates of a source at every occupied cell."""
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
    """Yield a pair from each of `count` scenes, each with a sensor and a place of its own."""
    config = SyntheticConfig(scenes=count, seed=SEED, duration_s=1.0, sensor="random")
    dataset = SyntheticDataset(config)
    for name in dataset.scene_names:
        yield held_out_pair(dataset.scene(name), INDEX, grid)


def held_out_pair(scene: SyntheticScene, index: int, grid: BevGrid) -> HeldOut:
    """Return the sweep at `index` of a scene and the one before it, with truth on `grid`."""
    indices = (index - 1, index)
    previous, current = (scene.sweep(i) for i in indices)
    then, now = (scene.sweep_truth(i) for i in indices)
    kept = _kept_rows(current)
    rows, columns, inside = grid.cells(current.xyz_m[kept])
    flat = (rows * grid.shape[1] + columns)[inside]
    object_id, velocity_mps = now.object_id[kept][inside], now.velocity_mps[kept][inside]
    seen = observable_points(then.object_id[_kept_rows(previous)], object_id)
    points = np.maximum(np.bincount(flat, minlength=grid.shape[0] * grid.shape[1]), 1)

    def mean(values: Floats) -> F32:
        sums = np.bincount(flat, weights=values, minlength=len(points)) / points
        return sums.reshape(grid.shape).astype(np.float32)

    return HeldOut(
        frames=(scene.frame(index - 1), scene.frame(index)),
        previous=previous,
        current=current,
        occupied=grid.occupancy(current.xyz_m[kept]),
        velocity_mps=np.stack([mean(velocity_mps[:, i]) for i in range(2)], axis=-1),
        observable=mean(seen.astype(np.float32)) > 0.5,
    )


def observable_points(then: I64, now: I64) -> Mask:
    """Return (N,) whether the object of each current point has enough points in both sweeps."""
    both = [np.unique(ids[ids >= 0], return_counts=True) for ids in (then, now)]
    enough = [ids[counts >= MIN_POINTS] for ids, counts in both]
    return (now < 0) | (np.isin(now, enough[0]) & np.isin(now, enough[1]))


def _kept_rows(sweep: Sweep) -> I64:
    """Return the rows of the points above the ground."""
    rows = np.arange(len(sweep), dtype=np.int64)
    kept, _ = keep_points(replace(sweep, time_offset_ns=rows, ring=None), GroundStage())
    return kept.time_offset_ns
