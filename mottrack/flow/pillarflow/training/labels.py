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
from mottrack.flow.pillarflow.training.examples import Labels
from mottrack.lidar.in_boxes import points_in_boxes

MARGIN_M = 0.15
"""Annotated boxes are tight and a few centimetres off; this many belong to an object's surface."""


def labels_from_tracks(
    previous: Sweep, current: Sweep, previous_truth: Truth, current_truth: Truth
) -> Labels:
    """Return the labels of two sweeps from the boxes at their stamps (any frame of `Truth`).

    Objects without a box in both sweeps get a centre of their own but no velocity.
    """
    ego_T_world = current.world_T_ego.inverse()
    then, now = (
        boxes if boxes.frame == "ego" else boxes.transformed(ego_T_world, "ego")
        for boxes in (previous_truth, current_truth)
    )
    rows_then, rows_now = (
        points_in_boxes(
            sweep.xyz_m, boxes.centre_m, boxes.size_m, boxes.yaw_rad, MARGIN_M
        ).first_box(len(sweep))
        for sweep, boxes in ((previous.seen_from(current), then), (current, now))
    )
    partner = _partners(now.id, then.id)
    paired = partner >= 0
    centre_m = np.stack([now.centre_m[:, :2]] * 2, axis=1)
    centre_m[paired, 0] = then.centre_m[partner[paired], :2]
    elapsed_s = seconds_between(previous.stamp_ns, current.stamp_ns)
    motion_m = _displacements(current.xyz_m, rows_now, then, now, partner)
    return Labels(
        previous_object=_renumbered(rows_then, partner, len(then)),
        current_object=rows_now.astype(np.int16),
        velocity_mps=motion_m / np.float32(elapsed_s),
        centre_m=centre_m.astype(np.float32),
    )


def _partners(ids: I64, others: I64) -> I64:
    """Return the row of each id among the others, -1 where absent."""
    rows = {int(one): row for row, one in enumerate(others)}
    return np.array([rows.get(int(one), -1) for one in ids], np.int64)


def _renumbered(rows: I64, partner: I64, count: int) -> I16:
    """Turn rows of the earlier boxes into rows of the later ones, -1 where an object has gone."""
    later = np.full(count + 1, -1, np.int64)
    later[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    return later[rows].astype(np.int16)


def _displacements(xyz_m: F32, rows: I64, then: Truth, now: Truth, partner: I64) -> F32:
    """Return (N,2) the displacement of each point with its box; zero elsewhere."""
    motion_m = np.zeros((len(xyz_m), 2), np.float32)
    for row in np.flatnonzero(partner >= 0):
        on = rows == row
        before = partner[row]
        rotation = rotation_2d(float(then.yaw_rad[before] - now.yaw_rad[row]))
        offset = xyz_m[on, :2] - now.centre_m[row, :2]
        motion_m[on] = xyz_m[on, :2] - (offset @ rotation.T + then.centre_m[before, :2])
    return motion_m
