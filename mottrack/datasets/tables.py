"""Boxes of a whole scene as flat arrays, and the boxes of one frame out of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import Objects, Pose, Truth, TruthTable, VelocityMeasurement
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.pose import wrap_angle


@dataclass(frozen=True)
class DetectionTable:
    """N detections of a scene, world frame.

    frame: (N,) index of the frame.
    label: (N,) class name.
    score: (N,) the detector's own score; only its order means something.
    centre_m, size_m (l, w, h): (N, 3). yaw_rad: (N,).
    velocity_mps: (N, 2) the detector's own velocity, or None.
    """

    frame: I64
    label: Texts
    score: F64
    centre_m: F64
    size_m: F64
    yaw_rad: F64
    velocity_mps: F64 | None = None

    def objects(self, frame: int, stamp_ns: int) -> Objects:
        """Return the detections of one frame."""
        rows = np.flatnonzero(self.frame == frame)
        return Objects(
            stamp_ns=stamp_ns,
            frame="world",
            centre_m=self.centre_m[rows],
            size_m=self.size_m[rows],
            yaw_rad=self.yaw_rad[rows],
            label=self.label[rows],
            score=self.score[rows],
            velocity=self._velocity(rows),
        )

    def _velocity(self, rows: I64) -> VelocityMeasurement | None:
        return None if self.velocity_mps is None else detector_velocity(self.velocity_mps[rows])

    def without_velocity(self) -> DetectionTable:
        """Return the same detections, as of a detector that reports no velocities."""
        return replace(self, velocity_mps=None)

    @classmethod
    def stacked(cls, parts: Sequence[DetectionTable]) -> DetectionTable:
        """Return the rows of all parts, which either all have velocities or none has."""
        columns: dict[str, Any] = {}
        for name in (f.name for f in fields(cls)):
            values = [getattr(part, name) for part in parts]
            columns[name] = None if values[0] is None else np.concatenate(values)
        return cls(**columns)

    def select(self, index: NDArray[Any]) -> DetectionTable:
        """Return the rows that a mask or an index picks."""
        columns: dict[str, Any] = {}
        for name in (f.name for f in fields(self)):
            values = getattr(self, name)
            columns[name] = None if values is None else values[index]
        return DetectionTable(**columns)


DETECTOR_VELOCITY_STD_MPS = 1.0
"""Files of detections carry no uncertainty; a tracker that wants another value sets its own."""


def detector_velocity(velocity_mps: F64) -> VelocityMeasurement:
    """Return a detector's (N, 2) velocities as measurements; NaN is absent."""
    valid = np.asarray(np.isfinite(velocity_mps).all(axis=1))
    variance = DETECTOR_VELOCITY_STD_MPS**2
    covariance = np.broadcast_to(np.eye(2) * variance, (len(valid), 2, 2)).copy()
    return VelocityMeasurement(np.where(valid[:, None], velocity_mps, 0.0), covariance, valid)


def truth_of(table: TruthTable, frame: int, stamp_ns: int) -> Truth:
    """Return the truth of one frame out of a scene's table, which is sorted by frame."""
    rows = slice(*np.searchsorted(table.frame, [frame, frame + 1]))
    columns: dict[str, Any] = {
        f.name: getattr(table, f.name)[rows] for f in fields(table) if f.name != "frame"
    }
    return Truth(stamp_ns=stamp_ns, frame="world", **columns)


def to_world(
    centre_m: F64,
    yaw_rad: F64,
    pose_of_box: I64,
    poses: list[Pose],
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
    turn = np.array([pose.yaw_rad for pose in poses])[pose_of_box]
    return np.einsum("nij,nj->ni", rotation, centre_m) + translation, wrap_angle(yaw_rad + turn)
