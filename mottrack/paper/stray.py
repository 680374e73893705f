"""What runs saw of a mover that no detector knows: a ball, an animal, something on the road."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import ObjectTable, Snapshot
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.velocity_error import VelocityErrorConfig
from mottrack.geometry.iou import bev_intersection, boxes7

BALL = "ball"
MOVING_MPS = 0.5
FEWEST_ROWS = 5
"""A ball that was tracked for fewer frames a run shows nothing."""
OVERLAP = 0.5
"""Share of a track's box that must lie where the mover was seen."""
TURN_S = VelocityErrorConfig().revolution_s
"""One turn of the LiDAR, which ends at the stamp of its sweep; as the velocity error takes it."""


@dataclass(frozen=True)
class Sighting:
    """Rows of tracks or clusters that are the mover, world frame, in order of frames."""

    frame: I64
    """(K,)"""
    xy_m: F64
    """(K, 2)"""
    velocity_mps: F64
    """(K, 2); NaN where a cluster's velocity was not measured."""
    tracks: int = 0
    """How many tracks they are of; 0 for clusters."""

    @property
    def speed_mps(self) -> F64:
        """(K,) over the ground."""
        speed: F64 = np.hypot(*self.velocity_mps.T)
        return speed


def best_tracked(results: Sequence[SceneResult]) -> int | None:
    """Identity of the ball with most track rows in runs over one scene.

    Where none has enough, of the mover with most rows that no detector knows; None without any.
    """
    truth = results[0].truth
    moves = np.hypot(*truth.velocity_mps.T) > MOVING_MPS
    strays = np.unique(truth.id[moves & ~np.isin(truth.label, results[0].classes)])
    if not len(strays):
        return None
    rows = np.array([sum(len(tracked(r, int(s)).frame) for r in results) for s in strays])
    is_ball = np.isin(strays, truth.id[truth.label == BALL])
    enough = is_ball & (rows >= FEWEST_ROWS * len(results))
    rows = np.where(enough, rows + rows.max(), rows)
    return int(strays[np.argmax(rows)]) if rows.any() else None


def tracked(result: SceneResult, stray: int) -> Sighting:
    """The observed track rows that are the mover."""
    truth = result.truth.select(result.truth.id == stray)
    tables = (
        result.tracks.select((result.tracks.frame == frame) & result.tracks.observed)
        for frame in truth.frame
    )
    return _sighting(truth, tables)


def clustered(result: SceneResult, snapshots: Iterable[Snapshot], stray: int) -> Sighting:
    """The clusters that are the mover, with the velocity that the flow gave them."""
    truth = result.truth.select(result.truth.id == stray)
    objects = {shot.frame: shot.objects for shot in snapshots}
    nothing = ObjectTable.empty()
    return _sighting(truth, (objects.get(int(frame), nothing) for frame in truth.frame))


def _sighting(truth: TruthTable, tables: Iterable[TrackTable | ObjectTable]) -> Sighting:
    where = swept_boxes(truth)
    frames: list[int] = []
    found = [np.zeros((0, 4))]
    ids: set[int] = set()
    for frame, box, table in zip(truth.frame, where, tables, strict=True):
        boxes = boxes7(table.centre_m, table.size_m, table.yaw_rad)
        share = bev_intersection(boxes, box[None])[:, 0] / np.prod(table.size_m[:, :2], axis=1)
        rows = table.select(share > OVERLAP)
        frames += [int(frame)] * len(rows)
        found.append(np.column_stack([rows.centre_m[:, :2], rows.velocity_mps]))
        if isinstance(rows, TrackTable):
            ids.update(rows.id.tolist())
    seen = np.concatenate(found)
    return Sighting(np.array(frames, np.int64), seen[:, :2], seen[:, 2:], len(ids))


def swept_boxes(truth: TruthTable) -> F64:
    """(N, 7) x, y, z, l, w, h, yaw of where a turn of the LiDAR may have seen each true box.

    A ball of 0.3 m at 6 m/s goes twice its size in a turn: the box at the stamp does not hold the
    points that were measured on it before.
    """
    way_m = truth.velocity_mps * TURN_S
    length_m = np.hypot(*way_m.T) + truth.size_m[:, 0]
    centre_m = truth.centre_m - np.insert(0.5 * way_m, 2, 0.0, axis=1)
    size_m = np.column_stack([length_m, truth.size_m[:, 1:]])
    return boxes7(centre_m, size_m, np.arctan2(way_m[:, 1], way_m[:, 0]))
