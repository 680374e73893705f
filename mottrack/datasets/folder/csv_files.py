"""The text files of an own log: poses, labelled boxes, detections."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import Pose, TruthTable
from mottrack.core.arrays import F64
from mottrack.datasets.faults import OutOfOrderError
from mottrack.datasets.files import Column, check_boxes, read_table, refuse_rows, repeated_rows
from mottrack.datasets.kinematics import centred_velocities
from mottrack.datasets.rigid import quaternion_pose
from mottrack.datasets.tables import DetectionTable, to_world

_STAMP = Column("stamp_ns", int)
_POSE = (_STAMP, *(Column(name) for name in ("x", "y", "z", "qw", "qx", "qy", "qz")))
_BOX = tuple(Column(name) for name in ("x", "y", "z", "length", "width", "height", "yaw"))
_LABELLED = (_STAMP, Column("id", int), Column("label", str), *_BOX)
_DETECTED = (_STAMP, Column("label", str), Column("score"), *_BOX)
Columns = dict[str, NDArray[Any]]


def read_poses(path: Path) -> dict[int, Pose]:
    """Return `world_T_ego` by stamp, in order of time.

    Raises:
        DataError: a broken line, a stamp that is not later than the one before, or a quaternion
            that is not a unit one.

    """
    table = read_table(path, _POSE, separator=",", header=True)
    poses: dict[int, Pose] = {}
    last: int | None = None
    for i, stamp in enumerate(table["stamp_ns"].tolist()):
        line = f"line {table['line'][i]}"
        if last is not None and stamp <= last:
            raise OutOfOrderError(path, f"{line}, stamp_ns", stamp, f"later than {last}")
        place = np.array([table[axis][i] for axis in "xyz"])
        turn = np.array([table[name][i] for name in ("qw", "qx", "qy", "qz")])
        poses[stamp], last = quaternion_pose(turn, place, path, f"{line}, pose"), stamp
    return poses


def read_boxes(path: Path, poses: Mapping[int, Pose]) -> TruthTable:
    """Return the labelled boxes in the world; velocities follow from the positions.

    Raises:
        DataError: a broken line, a value out of range, a stamp without a pose, or an identity twice
            at one stamp.

    """
    table = _in_frames(path, read_table(path, _LABELLED, separator=",", header=True), poses)
    repeated = repeated_rows(np.column_stack([table["frame"], table["id"]]))
    refuse_rows(path, table, repeated, "id", "each identity once a stamp")
    centre_m, yaw_rad, size_m = _placed(table, poses)
    return TruthTable(
        frame=table["frame"],
        id=table["id"],
        label=table["label"],
        centre_m=centre_m,
        size_m=size_m,
        yaw_rad=yaw_rad,
        velocity_mps=centred_velocities(table["id"], table["stamp_ns"], centre_m),
        num_points=np.full(len(repeated), -1),
        interpolated=np.zeros(len(repeated), dtype=bool),
    )


def read_detections(path: Path, poses: Mapping[int, Pose]) -> DetectionTable:
    """Return the detections in the world.

    Raises:
        DataError: a broken line, a value out of range, or a stamp without a pose.

    """
    table = _in_frames(path, read_table(path, _DETECTED, separator=",", header=True), poses)
    centre_m, yaw_rad, size_m = _placed(table, poses)
    return DetectionTable(table["frame"], table["label"], table["score"], centre_m, size_m, yaw_rad)


def _in_frames(path: Path, table: Columns, poses: Mapping[int, Pose]) -> Columns:
    """Check the rows, add the index of their frame and sort by it."""
    index = {stamp: i for i, stamp in enumerate(poses)}
    check_boxes(path, table, ("length", "width", "height"), ("x", "y", "z"), "yaw")
    refuse_rows(path, table, table["label"] == "", "label", "a name")
    lost = np.array([stamp not in index for stamp in table["stamp_ns"].tolist()], dtype=bool)
    refuse_rows(path, table, lost, "stamp_ns", "a stamp of poses.csv")
    frame = np.array([index[s] for s in table["stamp_ns"].tolist()], dtype=np.int64)
    order = np.argsort(frame, kind="stable")
    return {name: values[order] for name, values in (table | {"frame": frame}).items()}


def _placed(table: Columns, poses: Mapping[int, Pose]) -> tuple[F64, F64, F64]:
    centre = np.column_stack([table["x"], table["y"], table["z"]])
    size = np.column_stack([table["length"], table["width"], table["height"]])
    return (*to_world(centre, table["yaw"], table["frame"], list(poses.values())), size)
