"""Truth of a scene: at key frames as annotated, between them interpolated on request."""

from __future__ import annotations

from typing import Any

import numpy as np

from mottrack.core import Truth, TruthTable
from mottrack.core.arrays import F64, I64
from mottrack.core.pose import wrap_angle
from mottrack.datasets.kinematics import centred_velocities
from mottrack.datasets.nuscenes.config import CATEGORY_MAP
from mottrack.datasets.nuscenes.record import SceneRecord
from mottrack.datasets.nuscenes.tables import text_of
from mottrack.datasets.tables import truth_of


def yaw_of(quaternion_wxyz: F64) -> F64:
    """Return the headings (N,) of (N, 4) quaternions: that of the turned x axis on the ground."""
    w, x, y, z = quaternion_wxyz.T
    heading: F64 = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return wrap_angle(heading)


def key_frame_truth(record: SceneRecord) -> TruthTable | None:
    """Return the annotations, `frame` counting key frames; None where nobody annotated.

    Velocities follow nuScenes' own rule: the difference of the neighbouring annotations'
    positions, centred where both exist, unknown over more than 1.5 s (3 s centred).
    """
    if not record.annotated[0]:
        return None
    key_stamp_us = record.sweep_stamp_us[record.sweep_sample >= 0]
    stamp_ns = key_stamp_us[record.box_sample] * 1000
    categories = text_of(record.box_category)
    return TruthTable(
        frame=record.box_sample,
        id=record.box_instance,
        label=np.array([CATEGORY_MAP.get(name, name) for name in categories], dtype=np.str_),
        centre_m=record.box_centre_m,
        size_m=record.box_size_wlh_m[:, [1, 0, 2]],
        yaw_rad=yaw_of(record.box_rotation),
        velocity_mps=centred_velocities(record.box_instance, stamp_ns, record.box_centre_m),
        num_points=record.box_points,
        interpolated=np.zeros(len(stamp_ns), dtype=bool),
    )


def interpolated_truth(
    table: TruthTable, key_frame: int, key_stamp_ns: I64, stamp_ns: int
) -> Truth:
    """Return the truth between two key frames, of the objects annotated in both.

    Args:
        table: truth at key frames.
        key_frame: the last key frame before `stamp_ns`; there is one after it.
        key_stamp_ns: (K,) times of the key frames.
        stamp_ns: the time wanted.

    """
    before = truth_of(table, key_frame, int(key_stamp_ns[key_frame]))
    after = truth_of(table, key_frame + 1, int(key_stamp_ns[key_frame + 1]))
    _, left, right = np.intersect1d(before.id, after.id, return_indices=True)
    before, after = before.select(left), after.select(right)
    elapsed_ns = after.stamp_ns - before.stamp_ns
    share = (stamp_ns - before.stamp_ns) / elapsed_ns
    moved = after.centre_m - before.centre_m
    values: dict[str, Any] = {
        "centre_m": before.centre_m + share * moved,
        "yaw_rad": wrap_angle(before.yaw_rad + share * wrap_angle(after.yaw_rad - before.yaw_rad)),
        "velocity_mps": moved[:, :2] / (elapsed_ns * 1e-9),
    }
    return Truth(
        stamp_ns=stamp_ns,
        frame="world",
        size_m=before.size_m,
        label=before.label,
        id=before.id,
        num_points=np.full(len(before), -1),
        interpolated=np.ones(len(before), dtype=bool),
        **values,
    )
