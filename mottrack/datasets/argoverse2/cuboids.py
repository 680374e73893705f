"""Cuboids in feather files: annotations of a log, and detections."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mottrack.core import Pose, TruthTable
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.errors import DataError
from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.argoverse2.feather import (
    POSE,
    SIZE,
    Columns,
    read_columns,
    refuse,
    require_integers,
    stacked,
)
from mottrack.datasets.files import MAX_BOX_RANGE_M, MAX_BOX_SIZE_M, repeated_rows
from mottrack.datasets.kinematics import centred_velocities
from mottrack.datasets.rigid import quaternion_length
from mottrack.datasets.tables import DetectionTable, to_world

_CUBOID = ("timestamp_ns", *SIZE, *POSE)


def annotation_stamps(path: Path) -> I64:
    """Return the annotated times in nanoseconds, ascending."""
    columns = read_columns(path, ("timestamp_ns",))
    return np.unique(require_integers(path, columns, "timestamp_ns"))


def read_annotations(
    path: Path, stamps: list[int], poses: list[Pose], config: Argoverse2Config
) -> TruthTable:
    """Return the annotations at these frames in the world.

    Args:
        path: `annotations.feather`.
        stamps: time of each frame, ascending.
        poses: `world_T_ego` of each frame.
        config: names the classes.

    Raises:
        DataError: damaged file, a value out of range, or a track twice at one time.

    """
    columns = read_columns(path, (*_CUBOID, "num_interior_pts"), ("track_uuid", "category"))
    _check(path, columns)
    columns = _at_frames(path, columns, stamps)
    points = require_integers(path, columns, "num_interior_pts")
    refuse(path, points < 0, "num_interior_pts", points, "0 or more")
    identity = np.unique(columns["track_uuid"], return_inverse=True)[1].astype(np.int64)
    _check_unique(path, columns, identity)
    centre_m, yaw_rad = _in_world(columns, poses)
    stamp_ns = np.array(stamps, dtype=np.int64)[columns["frame"]]
    return TruthTable(
        frame=columns["frame"],
        id=identity,
        label=_labels(columns["category"], config),
        centre_m=centre_m,
        size_m=stacked(columns, SIZE),
        yaw_rad=yaw_rad,
        velocity_mps=centred_velocities(identity, stamp_ns, centre_m),
        num_points=points,
        interpolated=np.zeros(len(stamp_ns), dtype=bool),
    )


def read_detections(
    path: Path, log: str, frames: tuple[list[int], list[Pose]], config: Argoverse2Config
) -> DetectionTable | None:
    """Return the detections of a log in the world; None if the file has none of this log.

    The columns are those of an Argoverse 2 detection submission, cuboids in the ego frame.

    Raises:
        DataError: damaged file, a value out of range, or no time that is a frame's.

    """
    stamps, poses = frames
    columns = read_columns(path, (*_CUBOID, "score"), ("log_id", "category"))
    columns = {name: values[columns["log_id"] == log] for name, values in columns.items()}
    if not len(columns["score"]):
        return None
    _check(path, columns)
    first_ns = columns["timestamp_ns"][0]
    columns = _at_frames(path, columns, stamps)
    if not len(columns["score"]) and config.frames is None:
        raise DataError(
            path, f"timestamp_ns of {log}", first_ns, "a frame's, as no other is either"
        )
    centre_m, yaw_rad = _in_world(columns, poses)
    return DetectionTable(
        frame=columns["frame"],
        label=_labels(columns["category"], config),
        score=columns["score"].astype(np.float64),
        centre_m=centre_m,
        size_m=stacked(columns, SIZE),
        yaw_rad=yaw_rad,
    )


def _at_frames(path: Path, columns: Columns, stamps: list[int]) -> Columns:
    """The rows whose time is that of a frame, sorted by frame, with its index."""
    time = require_integers(path, columns, "timestamp_ns")
    frame_stamps = np.array(stamps, dtype=np.int64)
    frame = np.searchsorted(frame_stamps, time)
    known = frame_stamps[np.minimum(frame, len(frame_stamps) - 1)] == time
    rows = np.flatnonzero(known)
    rows = rows[np.argsort(frame[rows], kind="stable")]
    kept = {name: values[rows] for name, values in columns.items()}
    return kept | {"frame": frame[rows].astype(np.int64)}


def _in_world(columns: Columns, poses: list[Pose]) -> tuple[F64, F64]:
    values = stacked(columns, POSE)
    w, x, y, z = values[:, :4].T
    yaw_rad = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return to_world(values[:, 4:], yaw_rad, columns["frame"], poses)


def _labels(category: Texts, config: Argoverse2Config) -> Texts:
    names = [config.class_map.get(str(c), str(c).lower()) for c in category]
    return np.array(names, dtype=np.str_)


def _check(path: Path, columns: Columns) -> None:
    size, pose = stacked(columns, SIZE), stacked(columns, POSE)
    length = quaternion_length(pose[:, :4])
    largest = size.max(axis=1, initial=1.0)
    outside = (size.min(axis=1, initial=1.0) <= 0.0) | (largest > MAX_BOX_SIZE_M)
    refuse(path, outside, "size", size, f"in (0, {MAX_BOX_SIZE_M:g}] m")
    refuse(path, np.abs(length - 1.0) > 1e-3, "rotation", pose[:, :4], "a unit quaternion")
    too_far = np.abs(pose[:, 4:]).max(axis=1, initial=0.0) > MAX_BOX_RANGE_M
    expected = f"within {MAX_BOX_RANGE_M:g} m of the vehicle"
    refuse(path, too_far, "translation", pose[:, 4:], expected)
    refuse(path, columns["category"] == "", "category", columns["category"], "a name")


def _check_unique(path: Path, columns: Columns, identity: I64) -> None:
    rows = np.flatnonzero(repeated_rows(np.column_stack([columns["frame"], identity])))
    if rows.size:
        row = rows[0]
        value = f"{columns['track_uuid'][row]} twice at {columns['timestamp_ns'][row]}"
        raise DataError(path, "track_uuid", value, "each track once a time")
