"""Boxes of a whole scene as flat arrays, and the boxes of one frame out of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mottrack.core import Objects, Pose, Truth, TruthTable, VelocityMeasurement
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.checks import Column, Columns
from mottrack.core.pose import wrap_angle
from mottrack.core.tables import Table

DETECTOR_VELOCITY_STD_MPS = 1.0
"""Files of detections carry no uncertainty; a tracker that wants another value sets its own."""


@dataclass(frozen=True, slots=True)
class DetectionTable(Table):
    """Detections of a scene, world frame.

    frame: (N,) index of the frame.
    label: (N,) class name.
    score: (N,) the detector's own score; only its order means something.
    centre_m, size_m (l, w, h): (N, 3). yaw_rad: (N,).
    velocity_mps: (N, 2) the detector's own velocity, NaN where it reports none.
    """

    COLUMNS: ClassVar[Columns] = {
        "frame": Column(np.int64),
        "label": Column(np.str_),
        "score": Column(np.float64),
        "centre_m": Column(np.float64, (3,)),
        "size_m": Column(np.float64, (3,)),
        "yaw_rad": Column(np.float64),
        "velocity_mps": Column(np.float64, (2,)),
    }
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset({"velocity_mps"})

    frame: I64
    label: Texts
    score: F64
    centre_m: F64
    size_m: F64
    yaw_rad: F64
    velocity_mps: F64


def objects_of(
    table: DetectionTable | None, frame: int, stamp_ns: int, *, velocities: bool = False
) -> Objects | None:
    """Return the detections of one frame; None where no detector ran on the scene.

    Args:
        table: detections of the scene.
        frame: index of the frame.
        stamp_ns: its time.
        velocities: whether the detector's own velocities are measurements.
    """
    if table is None:
        return None
    rows = table.select(np.flatnonzero(table.frame == frame))
    return Objects(
        stamp_ns=stamp_ns,
        frame="world",
        centre_m=rows.centre_m,
        size_m=rows.size_m,
        yaw_rad=rows.yaw_rad,
        label=rows.label,
        score=rows.score,
        velocity=_detector_velocity(rows.velocity_mps) if velocities else None,
    )


def _detector_velocity(velocity_mps: F64) -> VelocityMeasurement:
    """Return a detector's (N, 2) velocities as measurements."""
    valid = np.asarray(np.isfinite(velocity_mps).all(axis=1))
    covariance = np.tile(np.eye(2) * DETECTOR_VELOCITY_STD_MPS**2, (len(valid), 1, 1))
    return VelocityMeasurement(np.where(valid[:, None], velocity_mps, 0.0), covariance, valid)


def truth_of(table: TruthTable | None, frame: int, stamp_ns: int) -> Truth | None:
    """Return the truth of one frame; None where the scene is not annotated.

    Args:
        table: truth of the scene, sorted by frame.
        frame: index of the frame.
        stamp_ns: its time.
    """
    if table is None:
        return None
    rows = slice(*np.searchsorted(table.frame, [frame, frame + 1]))
    columns = {name: getattr(table, name)[rows] for name in table.COLUMNS if name != "frame"}
    return Truth(stamp_ns=stamp_ns, frame="world", **columns)


def frames_at(stamp_ns: I64, frame_stamps_ns: Sequence[int] | I64) -> I64:
    """Return the index (N,) of the frame at each of the stamps (N,), -1 where there is none.

    Args:
        stamp_ns: (N,) times in nanoseconds.
        frame_stamps_ns: time of each frame, ascending, at least one.
    """
    frame_stamps = np.array(frame_stamps_ns, dtype=np.int64)
    frame = np.searchsorted(frame_stamps, stamp_ns)
    found = frame_stamps[np.minimum(frame, len(frame_stamps) - 1)] == stamp_ns
    return np.where(found, frame, -1).astype(np.int64)


def to_world(
    centre_m: F64, yaw_rad: F64, pose_of_box: I64, poses: Sequence[Pose]
) -> tuple[F64, F64]:
    """Return centres (N, 3) and headings (N,) in the world of boxes given in ego frames.

    Args:
        centre_m: (N, 3) in the ego frame of each box's own pose.
        yaw_rad: (N,) likewise.
        pose_of_box: (N,) index into `poses`.
        poses: `world_T_ego` of each frame.
    """
    if not len(centre_m):
        return centre_m.reshape(0, 3), yaw_rad.reshape(0)
    rotation = np.stack([pose.rotation for pose in poses])[pose_of_box]
    translation = np.stack([pose.translation_m for pose in poses])[pose_of_box]
    ego_yaw = np.array([pose.yaw_rad for pose in poses])[pose_of_box]
    return np.einsum("nij,nj->ni", rotation, centre_m) + translation, wrap_angle(yaw_rad + ego_yaw)


def unknown_velocities(count: int) -> F64:
    """Return (count, 2) velocities of a detector that reports none."""
    return np.full((count, 2), np.nan)
