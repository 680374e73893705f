"""Truth of a pair of sweeps from annotated tracks (paper, section III-C).

"We estimate the instantaneous velocity from the difference in object positions divided by the
elapsed time between consecutive frames"; here with the change of heading too, so that the
corners of a turning bus move as they do. Everything without a track has velocity zero.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F32, I16, I64
from mottrack.core.objects import Truth
from mottrack.core.pose import rotation_2d
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.flow.pillarflow.training.example import Labels
from mottrack.lidar.in_boxes import points_in_boxes

MARGIN_M = 0.15


def labels_from_tracks(previous: Sweep, current: Sweep, then: Truth, now: Truth) -> Labels:
    """Labels of two sweeps from the boxes at their stamps (any frame of `Truth`).

    Objects without a box in both sweeps get a centre of their own but no velocity.
    """
    ego_T_world = current.world_T_ego.inverse()
    then, now = (
        boxes if boxes.frame == "ego" else boxes.transformed(ego_T_world, "ego")
        for boxes in (then, now)
    )
    moved = previous.seen_from(current)
    rows_now = points_in_boxes(
        current.xyz_m, now.centre_m, now.size_m, now.yaw_rad, MARGIN_M
    ).first_box(len(current))
    rows_then = points_in_boxes(
        moved.xyz_m, then.centre_m, then.size_m, then.yaw_rad, MARGIN_M
    ).first_box(len(previous))
    partner = _partners(now.id, then.id)
    elapsed_s = seconds_between(previous.stamp_ns, current.stamp_ns)
    centre = np.stack([now.centre_m[:, :2]] * 2, axis=1)
    paired = partner >= 0
    centre[paired, 0] = then.centre_m[partner[paired], :2]
    return Labels(
        previous_object=_renamed(rows_then, partner, len(then)),
        current_object=rows_now.astype(np.int16),
        velocity_mps=_velocities(current, rows_now, (then, now), partner) / np.float32(elapsed_s),
        centre_m=centre.astype(np.float32),
    )


def _partners(ids: I64, others: I64) -> I64:
    """Row of each id among the others, -1 where absent."""
    rows = {int(one): row for row, one in enumerate(others)}
    return np.array([rows.get(int(one), -1) for one in ids], np.int64)


def _renamed(rows: I64, partner: I64, count: int) -> I16:
    """Rows of the earlier boxes -> rows of the later ones, -1 where an object has gone."""
    later = np.full(count + 1, -1, np.int64)
    later[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    return later[rows].astype(np.int16)


def _velocities(
    current: Sweep,
    rows: I64,
    boxes: tuple[Truth, Truth],
    partner: I64,
) -> F32:
    """(N,2) way of each point with its box; zero elsewhere."""
    then, now = boxes
    way = np.zeros((len(current), 2), np.float32)
    for row in np.flatnonzero(partner >= 0):
        on = rows == row
        turned = rotation_2d(float(then.yaw_rad[partner[row]] - now.yaw_rad[row]))
        offset = current.xyz_m[on, :2] - now.centre_m[row, :2]
        way[on] = current.xyz_m[on, :2] - (offset @ turned.T + then.centre_m[partner[row], :2])
    return way
