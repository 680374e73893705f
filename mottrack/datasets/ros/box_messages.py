"""Boxes of detectors, trackers and labels in messages of ROS, by the definition in the log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core import TruthTable
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.errors import DataError
from mottrack.core.objects import GENERIC
from mottrack.core.pose import rotation_2d
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.fitted_velocity import box_velocities
from mottrack.datasets.ros.messages import pose_values
from mottrack.datasets.ros.motion import Motion
from mottrack.datasets.ros.trajectory import composed
from mottrack.datasets.ros.transforms import frame_name, stamp_of
from mottrack.datasets.scene_boxes import DetectionTable
from mottrack.formats.checks import check_rotations, check_sizes, check_upright, check_world_places
from mottrack.formats.columns import Columns
from mottrack.formats.rigid import quaternion_wxyz, quaternion_yaws

POLYGON = 2
"""autoware_perception_msgs/msg/Shape's number of a footprint whose length and width are not set."""


class MessageBox(NamedTuple):
    """One box of a message, in the frame of the message.

    pose: quaternion w, x, y, z, then the centre. size_m: length, width, height.
    velocity_mps: x, y in the box's own axes, NaN where there is none.
    identity: of a track or a labelled object, else "".
    """

    label: str
    score: float
    identity: str
    pose: Sequence[float]
    size_m: Sequence[float]
    velocity_mps: Sequence[float]


class _Row(NamedTuple):
    """A box, the frame that it belongs to, and the stamp of its message."""

    frame: int
    stamp_ns: int
    box: MessageBox


class MessageBoxes(NamedTuple):
    """N boxes of a log in the world, sorted by frame.

    frame, label, score, size_m (N, 3), pose (N, 7), velocity_mps (N, 2) in the box's own axes,
    identity (N,).
    """

    frame: I64
    label: Texts
    score: F64
    size_m: F64
    pose: F64
    velocity_mps: F64
    identity: Texts
    seen: tuple[int, ...]
    """The frames that have a message, with boxes or without."""
    unmatched: int
    """Messages that belong to no frame."""

    @property
    def yaw_rad(self) -> F64:
        """(N,) headings in the world."""
        return quaternion_yaws(self.pose[:, :4])

    def detections(self) -> DetectionTable:
        """Return the boxes as detections."""
        turn = rotation_2d_many(self.yaw_rad)
        return DetectionTable(
            frame=self.frame,
            label=self.label,
            score=self.score,
            centre_m=self.pose[:, 4:],
            size_m=self.size_m,
            yaw_rad=self.yaw_rad,
            velocity_mps=np.einsum("nij,nj->ni", turn, self.velocity_mps),
        )

    def truth(self, stamps_ns: Sequence[int], *, fitted: bool) -> TruthTable:
        """Return the boxes as labels; velocities follow from the positions (`box_velocities`)."""
        identity = identities(self.identity)
        stamp_ns = np.array(stamps_ns, dtype=np.int64)[self.frame]
        return TruthTable(
            frame=self.frame,
            id=identity,
            label=self.label,
            centre_m=self.pose[:, 4:],
            size_m=self.size_m,
            yaw_rad=self.yaw_rad,
            velocity_mps=box_velocities(identity, stamp_ns, self.pose[:, 4:], fitted=fitted),
            num_points=np.full(len(identity), -1),
            interpolated=np.zeros(len(identity), dtype=bool),
        )


def rotation_2d_many(yaw_rad: F64) -> F64:
    """Return (N, 2, 2) rotations by (N,) angles."""
    return np.array([rotation_2d(float(angle)) for angle in yaw_rad]).reshape(-1, 2, 2)


def identities(names: Texts) -> I64:
    """Return numbers (N,) of objects: their own where all are numbers, else in order of name."""
    if all(str(name).isascii() and str(name).isdigit() and len(name) < 19 for name in names):
        return names.astype(np.int64)
    return np.unique(names, return_inverse=True)[1].astype(np.int64)


class BoxReader:
    """Reads messages with boxes: places them in the world and at frames."""

    def __init__(
        self, path: Path, motion: Motion, stamps_ns: Sequence[int], match_s: float
    ) -> None:
        self._path, self._motion = path, motion
        self._stamps_ns = np.array(stamps_ns, dtype=np.int64)
        self._match_ns = match_s * SECOND_NS

    def read(self, messages: Sequence[Any], class_map: Mapping[str, str]) -> MessageBoxes:
        """Return the boxes of the message nearest to each frame; other messages are left out.

        Raises:
            DataError: a frame that tf does not place, or a value out of range.
        """
        seen = self._nearest(messages)
        rows: list[_Row] = []
        poses: list[F64] = []
        for frame, message in seen.items():
            stamp_ns, boxes = stamp_of(message.header), boxes_of(message)
            rows += [_Row(frame, stamp_ns, box) for box in boxes]
            poses.append(self._in_world(message, stamp_ns, boxes))
        table = self._checked(rows, np.concatenate([np.zeros((0, 7)), *poses]))
        order = np.argsort(table["frame"], kind="stable")
        labels = [class_map.get(row.box.label, row.box.label.lower()) for row in rows]
        names = [row.box.identity for row in rows]
        return MessageBoxes(
            table["frame"][order],
            np.array(labels, dtype=np.str_)[order],
            table["score"][order],
            table["size"][order],
            np.hstack([table["rotation"], table["translation"]])[order],
            np.array([row.box.velocity_mps for row in rows]).reshape(-1, 2)[order],
            np.array(names, dtype=np.str_)[order],
            tuple(sorted(seen)),
            len(messages) - len(seen),
        )

    def _nearest(self, messages: Sequence[Any]) -> dict[int, Any]:
        """Return the message nearest to each frame, by frame, where one is near enough."""
        found: dict[int, Any] = {}
        apart_of: dict[int, int] = {}
        for message in messages:
            stamp_ns = stamp_of(message.header)
            frame = int(np.abs(self._stamps_ns - stamp_ns).argmin())
            apart = abs(int(self._stamps_ns[frame]) - stamp_ns)
            if apart <= min(self._match_ns, apart_of.get(frame, apart + 1) - 1):
                found[frame], apart_of[frame] = message, apart
        return found

    def _in_world(self, message: Any, stamp_ns: int, boxes: Sequence[MessageBox]) -> F64:
        """Return the poses (N, 7) of a message's boxes in the world."""
        frame = frame_name(message.header.frame_id)
        try:
            world_T_frame = self._motion.world_T(frame, stamp_ns)
        except KeyError as error:
            expected = f"{self._motion.world}, {self._motion.ego} or a frame that tf places"
            raise DataError(self._path, "frame_id of boxes", repr(frame), expected) from error
        own = np.array([box.pose for box in boxes], dtype=np.float64).reshape(-1, 7)
        moved = [*quaternion_wxyz(world_T_frame.rotation), *world_T_frame.translation_m]
        return composed(np.tile(moved, (len(own), 1)), own)

    def _checked(self, rows: Sequence[_Row], poses: F64) -> Columns:
        sizes = np.array([row.box.size_m for row in rows], dtype=np.float64).reshape(-1, 3)
        table = Columns(
            self._path,
            {
                "frame": np.array([row.frame for row in rows], dtype=np.int64),
                "score": np.array([row.box.score for row in rows], dtype=np.float64),
                "size": sizes,
                "rotation": poses[:, :4],
                "translation": poses[:, 4:],
            },
            np.array([row.stamp_ns for row in rows], dtype=np.int64),
            lambda name, stamp: f"{name} of a box at {stamp}",
        )
        for name in ("score", "size", "rotation", "translation"):
            table.refuse(name, ~np.isfinite(table[name]), "finite numbers")
        check_sizes(table, "size")
        check_rotations(table)
        check_upright(table)
        check_world_places(table)
        return table


def boxes_of(message: Any) -> list[MessageBox]:
    """Return the boxes of a Detection3DArray, or of DetectedObjects or TrackedObjects."""
    if hasattr(message, "detections"):
        return [_of_detection(one) for one in message.detections]
    return [_of_autoware(one) for one in message.objects]


def _of_detection(one: Any) -> MessageBox:
    # until Galactic id and score stood in the result itself
    found = [getattr(result, "hypothesis", result) for result in one.results]
    best = max(found, key=lambda hypothesis: hypothesis.score, default=None)
    label = (
        GENERIC if best is None else str(best.class_id if hasattr(best, "class_id") else best.id)
    )
    identity = one.id if hasattr(one, "id") else getattr(one, "tracking_id", "")
    s = one.bbox.size
    return MessageBox(
        label,
        1.0 if best is None else float(best.score),
        str(identity),
        pose_values(one.bbox.center),
        (s.x, s.y, s.z),
        (np.nan, np.nan),
    )


def _of_autoware(one: Any) -> MessageBox:
    best = max(one.classification, key=lambda each: each.probability, default=None)
    kinematics = one.kinematics
    moves = getattr(kinematics, "has_twist", True)
    twist = kinematics.twist_with_covariance.twist.linear
    identity = bytes(one.object_id.uuid).hex() if hasattr(one, "object_id") else ""
    return MessageBox(
        GENERIC if best is None else _class_name(best),
        float(one.existence_probability) * (1.0 if best is None else float(best.probability)),
        identity,
        pose_values(kinematics.pose_with_covariance.pose),
        _autoware_size(one.shape),
        (twist.x, twist.y) if moves else (np.nan, np.nan),
    )


def _class_name(classification: Any) -> str:
    """Return the name that the definition in the log gives to the number of a class."""
    number = int(classification.label)
    for name, value in vars(type(classification)).items():
        if name.isupper() and value == number:
            return str(name).lower()
    return str(number)


def _autoware_size(shape: Any) -> tuple[float, float, float]:
    d = shape.dimensions
    if shape.type != POLYGON:
        return (d.x, d.y, d.z)
    corners = np.array([[p.x, p.y] for p in shape.footprint.points]).reshape(-1, 2)
    length, width = 2.0 * np.abs(corners).max(axis=0, initial=0.0)
    return (float(length), float(width), d.z)
