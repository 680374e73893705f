"""Feather files of an Argoverse 2 log: poses, sweeps, annotations and detections."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core import Pose, Sweep, TruthTable
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_POINTS
from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.fitted_velocity import box_velocities
from mottrack.datasets.scene_boxes import (
    DetectionTable,
    frames_at,
    to_world,
    unknown_velocities,
)
from mottrack.formats.checks import (
    check_ego_places,
    check_interval,
    check_points,
    check_points_in_box,
    check_rings,
    check_rotations,
    check_sizes,
    check_upright,
    check_world_places,
)
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.faults import MissingError
from mottrack.formats.feather import read_feather_columns
from mottrack.formats.rigid import quaternion_pose, quaternion_yaws

ROTATION = ("qw", "qx", "qy", "qz")
TRANSLATION = ("tx_m", "ty_m", "tz_m")
SIZE = ("length_m", "width_m", "height_m")
UP_LIDAR = "up_lidar"
INTENSITY_MAX = 255.0
"""Argoverse stores the intensity in eight bits."""
MAX_OFFSET_NS = 1e9
"""A revolution takes a tenth of a second; of a sweep no point is a second away from its stamp."""
_STAMP_NAME = re.compile("[0-9]{1,19}")
_STAMP = ColumnSpec("timestamp_ns", int)
_POSE = specs(*ROTATION, *TRANSLATION)
CUBOID = (_STAMP, ColumnSpec("category", str), *specs(*SIZE), *_POSE)
_POINT = (
    *specs("x", "y", "z", "intensity"),
    *(ColumnSpec(n, int) for n in ("laser_number", "offset_ns")),
)


def read_poses(path: Path, stamps_ns: Sequence[int]) -> LogPoses:
    """Return `world_T_ego` at these times, ascending; the world is Argoverse's city frame.

    Raises:
        DataError: damaged file, no pose at one of the times, a stamp twice, a place far from
            Earth, or a quaternion that is not a unit one.
    """
    table = read_feather_columns(path, (_STAMP, *_POSE))
    table.refuse_repeated("timestamp_ns", table["timestamp_ns"], "each stamp once")
    table = table.extended(rotation=table.stacked(ROTATION), place=table.stacked(TRANSLATION))
    check_world_places(table, "place")
    check_rotations(table)
    row_of = {stamp: row for row, stamp in enumerate(table["timestamp_ns"].tolist())}
    poses = {}
    for stamp in stamps_ns:
        if stamp not in row_of:
            raise MissingError(path, "pose", "missing", f"a row with timestamp_ns {stamp}")
        row = row_of[stamp]
        rotation, place = table["rotation"][row], table["place"][row]
        poses[stamp] = quaternion_pose(rotation, place, path, f"pose of row {row}")
    return LogPoses(poses, np.sort(table["timestamp_ns"]))


def read_lidar_origin(path: Path) -> F64:
    """Return the upper LiDAR's place (3,) in the ego frame from `egovehicle_SE3_sensor.feather`.

    Both LiDARs are stacked on one axis within 30 cm of each other; the upper one stands for both.

    Raises:
        DataError: damaged file, no such sensor, or a mounting that is not rigid.
    """
    table = read_feather_columns(path, (*_POSE, ColumnSpec("sensor_name", str)))
    rows = np.flatnonzero(table["sensor_name"] == UP_LIDAR)
    if not rows.size:
        raise DataError(path, "sensor_name", "others only", UP_LIDAR)
    rotation, place = table.stacked(ROTATION)[rows[0]], table.stacked(TRANSLATION)[rows[0]]
    return quaternion_pose(rotation, place, path, f"mounting of {UP_LIDAR}").translation_m


def sweep_stamps(folder: Path) -> list[int]:
    """Return the times in nanoseconds for which there is a sweep, ascending."""
    names = (path.stem for path in folder.glob("*.feather"))
    return sorted(int(name) for name in names if _STAMP_NAME.fullmatch(name))


def read_sweep(path: Path, stamp_ns: int, world_T_ego: Pose, origin_m: F64) -> Sweep:
    """Read one sweep: x, y, z in the ego frame, motion-compensated, intensity 0 to 255.

    Raises:
        DataError: missing or damaged file, no points, a value that is not finite or out of range.
    """
    table = read_feather_columns(path, _POINT, MAX_POINTS)
    xyz_m = table.stacked(("x", "y", "z"))
    check_points(path, xyz_m)
    check_interval(path, "intensity", table["intensity"], INTENSITY_MAX)
    check_interval(path, "|offset_ns|", np.abs(table["offset_ns"]), MAX_OFFSET_NS)
    return Sweep(
        xyz_m=xyz_m.astype(np.float32),
        reflectance=(table["intensity"] / INTENSITY_MAX).astype(np.float32),
        stamp_ns=stamp_ns,
        world_T_ego=world_T_ego,
        origin_m=origin_m,
        time_offset_ns=table["offset_ns"],
        ring=check_rings(path, table["laser_number"]),
    )


def annotation_stamps(path: Path) -> I64:
    """Return the annotated times in nanoseconds, ascending."""
    return np.unique(read_feather_columns(path, (_STAMP,))["timestamp_ns"])


@dataclass(frozen=True)
class LogPoses:
    """The poses of a log.

    frames: `world_T_ego` by the stamp of each frame, ascending.
    every_stamp_ns: ascending times of all poses, frames or not.
    """

    frames: Mapping[int, Pose]
    every_stamp_ns: I64


def read_annotations(path: Path, poses: LogPoses, config: Argoverse2Config) -> TruthTable:
    """Return the annotations at the frames in the world.

    Args:
        path: `annotations.feather`.
        poses: of the log.
        config: names the classes, and how velocities are found.

    Raises:
        DataError: damaged file, a value out of range, or a track twice at one time.
    """
    further = (ColumnSpec("num_interior_pts", int), ColumnSpec("track_uuid", str))
    table = _at_frames(checked_cuboids(read_feather_columns(path, (*CUBOID, *further))), poses)
    check_points_in_box(table, "num_interior_pts")
    table.refuse("track_uuid", table["track_uuid"] == "", "a name")
    identity = np.unique(table["track_uuid"], return_inverse=True)[1].astype(np.int64)
    keys = np.column_stack([table["frame"], identity])
    table.refuse_repeated("track_uuid", keys, "each track once a time")
    centre_m, yaw_rad = _in_world(table, poses)
    return TruthTable(
        frame=table["frame"],
        id=identity,
        label=labels_of(table["category"], config.class_map),
        centre_m=centre_m,
        size_m=table["size"],
        yaw_rad=yaw_rad,
        velocity_mps=box_velocities(
            identity, table["timestamp_ns"], centre_m, fitted=config.fitted_velocity
        ),
        num_points=table["num_interior_pts"],
        interpolated=np.zeros(len(table), dtype=bool),
    )


def read_log_detections(
    path: Path, log: str, poses: LogPoses, config: Argoverse2Config
) -> DetectionTable | None:
    """Return the detections of a log in the world; None if the file has none of this log.

    The columns are those of an Argoverse 2 detection submission, cuboids in the ego frame.

    Raises:
        DataError: damaged file, a value out of range, or a time at which the log has no pose.
    """
    further = (ColumnSpec("score"), ColumnSpec("log_id", str))
    table = read_feather_columns(path, (*CUBOID, *further))
    table = table.select(table["log_id"] == log)
    if not len(table):
        return None
    table = _at_frames(checked_cuboids(table), poses)
    centre_m, yaw_rad = _in_world(table, poses)
    return DetectionTable(
        frame=table["frame"],
        label=labels_of(table["category"], config.class_map),
        score=table["score"],
        centre_m=centre_m,
        size_m=table["size"],
        yaw_rad=yaw_rad,
        velocity_mps=unknown_velocities(len(table)),
    )


def checked_cuboids(table: Columns) -> Columns:
    """Return the rows with size (N, 3), rotation (N, 4) and translation (N, 3), all in range."""
    table = table.extended(
        size=table.stacked(SIZE),
        rotation=table.stacked(ROTATION),
        translation=table.stacked(TRANSLATION),
    )
    check_sizes(table, "size")
    check_rotations(table)
    check_upright(table)
    check_ego_places(table, "translation")
    table.refuse("category", table["category"] == "", "a name")
    return table


def _at_frames(table: Columns, poses: LogPoses) -> Columns:
    """Return the rows whose time is that of a frame, sorted by frame, with its index."""
    _refuse_lost(table, poses.every_stamp_ns)
    frame = frames_at(table["timestamp_ns"], list(poses.frames))
    rows = np.flatnonzero(frame >= 0)
    order = rows[np.argsort(frame[rows], kind="stable")]
    return table.select(order).extended(frame=frame[order])


def _refuse_lost(table: Columns, stamps_ns: I64) -> None:
    """Refuse rows at whose time the log has no pose: they would be left out without a word."""
    lost = frames_at(table["timestamp_ns"], stamps_ns) < 0
    if lost.any():
        first = table["timestamp_ns"][np.argmax(lost)]
        near = int(np.abs(stamps_ns - first).min())
        expected = (
            f"the stamp of a pose, the nearest is {near} ns away; {np.count_nonzero(lost)} of "
            f"{len(table)} rows have none (float64 keeps no nanoseconds)"
        )
        table.refuse("timestamp_ns", lost, expected)


def _in_world(table: Columns, poses: LogPoses) -> tuple[F64, F64]:
    yaw_rad = quaternion_yaws(table["rotation"])
    return to_world(table["translation"], yaw_rad, table["frame"], list(poses.frames.values()))


def labels_of(category: Texts, class_map: Mapping[str, str]) -> Texts:
    """Return the label of each Argoverse category."""
    names = [class_map.get(str(c), str(c).lower()) for c in category]
    return np.array(names, dtype=np.str_)
