"""Truth of a scene: at key frames as annotated, between them interpolated on request."""

from __future__ import annotations

import numpy as np

from mottrack.core import Truth, TruthTable
from mottrack.core.arrays import I64
from mottrack.core.pose import wrap_angle
from mottrack.datasets.nuscenes.config import CATEGORY_MAP
from mottrack.datasets.nuscenes.records import SceneRecord
from mottrack.datasets.rigid import quaternion_yaws
from mottrack.datasets.scene_boxes import centred_velocities
from mottrack.formats.nuscenes_tables import text_of


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
        yaw_rad=wrap_angle(quaternion_yaws(record.box_rotation)),
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
    before, after = (table.select(table.frame == key) for key in (key_frame, key_frame + 1))
    _, left, right = np.intersect1d(before.id, after.id, return_indices=True)
    before, after = before.select(left), after.select(right)
    elapsed_ns = int(key_stamp_ns[key_frame + 1] - key_stamp_ns[key_frame])
    share = (stamp_ns - int(key_stamp_ns[key_frame])) / elapsed_ns
    moved = after.centre_m - before.centre_m
    turned = wrap_angle(after.yaw_rad - before.yaw_rad)
    return Truth(
        stamp_ns=stamp_ns,
        frame="world",
        centre_m=before.centre_m + share * moved,
        size_m=before.size_m,
        yaw_rad=wrap_angle(before.yaw_rad + share * turned),
        label=before.label,
        id=before.id,
        velocity_mps=moved[:, :2] / (elapsed_ns * 1e-9),
        num_points=np.full(len(left), -1),
        interpolated=np.ones(len(left), dtype=bool),
    )
