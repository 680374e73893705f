"""Which share of a true box other true boxes hide from the vehicle, from labels alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.result import SceneResult
from mottrack.core.tables import TruthTable
from mottrack.geometry.iou import bev_corners, boxes7

RAYS = 32
"""Directions that are looked at across each box: a share is exact to 3 %."""


def hidden_shares(result: SceneResult) -> dict[tuple[int, int], float]:
    """Return the hidden share of each true box of a scene, in [0, 1], by frame and identity.

    Seen from above, a ray to the box is hidden where it meets another true box, of any class, whose
    centre is nearer. Heights, and what no label knows of, are left out.
    """
    truth = result.truth
    order = np.argsort(truth.frame, kind="stable")
    edges = np.flatnonzero(np.diff(truth.frame[order])) + 1
    found: dict[tuple[int, int], float] = {}
    for rows in np.split(order, edges) if len(order) else ():
        frame = int(truth.frame[rows[0]])
        boxes = _Seen.of(truth.select(rows), result.frames.world_T_ego[frame, :2, 3])
        keys = ((frame, identity) for identity in boxes.id.tolist())
        found.update(zip(keys, _hidden(boxes).tolist(), strict=True))
    return found


class _Seen(NamedTuple):
    """Boxes of one frame as directions from the vehicle."""

    id: I64
    middle_rad: F64
    """(N,) of their centres."""
    reach_rad: F64
    """(2, N) from the first to the last corner, either side of the centre."""
    range_m: F64

    @classmethod
    def of(cls, boxes: TruthTable, ego_xy_m: F64) -> _Seen:
        corners = bev_corners(boxes7(boxes.centre_m, boxes.size_m, boxes.yaw_rad)) - ego_xy_m
        x, y = (boxes.centre_m[:, :2] - ego_xy_m).T
        middle_rad = np.arctan2(y, x)
        apart = _turned(np.arctan2(corners[..., 1], corners[..., 0]) - middle_rad[:, None])
        reach_rad = np.stack([apart.min(axis=1), apart.max(axis=1)])
        return cls(boxes.id, middle_rad, reach_rad, np.hypot(x, y))


def _hidden(boxes: _Seen) -> F64:
    low, high = boxes.reach_rad
    share = (np.arange(RAYS) + 0.5) / RAYS
    rays = boxes.middle_rad[:, None] + low[:, None] + (high - low)[:, None] * share
    nearer = boxes.range_m < boxes.range_m[:, None]
    apart = _turned(rays[:, :, None] - boxes.middle_rad)
    meets = (apart >= low) & (apart <= high)
    found: F64 = (meets & nearer[:, None, :]).any(axis=2).mean(axis=1)
    return found


def _turned(angle_rad: F64) -> F64:
    """Return angles in [-pi, pi)."""
    return np.mod(angle_rad + np.pi, 2 * np.pi) - np.pi
