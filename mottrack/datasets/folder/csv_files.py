"""The text files of an own log: poses, labelled boxes, detections."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mottrack.core import Pose, TruthTable
from mottrack.datasets.checks import check_ego_places, check_headings, check_sizes
from mottrack.datasets.rigid import quaternion_pose
from mottrack.datasets.scene_boxes import (
    DetectionTable,
    centred_velocities,
    frames_at,
    to_world,
)
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.faults import OutOfOrderError
from mottrack.formats.text_rows import read_text_columns

_PLACE, _ROTATION = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
_SIZE = ("length", "width", "height")
_STAMP, _LABEL = ColumnSpec("stamp_ns", int), ColumnSpec("label", str)
_POSE = (_STAMP, *specs(*_PLACE, *_ROTATION))
_BOX = specs(*_PLACE, *_SIZE, "yaw")
_LABELLED = (_STAMP, ColumnSpec("id", int), _LABEL, *_BOX)
_DETECTED = (_STAMP, _LABEL, *specs("score"), *_BOX)


def read_poses_csv(path: Path) -> dict[int, Pose]:
    """Return `world_T_ego` by stamp, in order of time.

    Raises:
        DataError: a broken line, a stamp that is not later than the one before, or a quaternion
            that is not a unit one.
    """
    table = read_text_columns(path, _POSE, separator=",", header=True)
    stamps = table["stamp_ns"].tolist()
    rotation, place = table.stacked(_ROTATION), table.stacked(_PLACE)
    poses = {}
    for i, (line, stamp) in enumerate(zip(table.row, stamps, strict=True)):
        if i and stamp <= stamps[i - 1]:
            expected = f"later than {stamps[i - 1]}"
            raise OutOfOrderError(path, f"line {line}, stamp_ns", stamp, expected)
        poses[stamp] = quaternion_pose(rotation[i], place[i], path, f"line {line}, pose")
    return poses


def read_boxes_csv(path: Path, poses: Mapping[int, Pose]) -> TruthTable:
    """Return the labelled boxes in the world; velocities follow from the positions.

    Raises:
        DataError: a broken line, a value out of range, a stamp without a pose, or an identity twice
            at one stamp.
    """
    table = _in_frames(read_text_columns(path, _LABELLED, separator=",", header=True), poses)
    keys = np.column_stack([table["frame"], table["id"]])
    table.refuse_repeated("id", keys, "each identity once a stamp")
    centre_m, yaw_rad = to_world(
        table.stacked(_PLACE), table["yaw"], table["frame"], list(poses.values())
    )
    return TruthTable(
        frame=table["frame"],
        id=table["id"],
        label=table["label"],
        centre_m=centre_m,
        size_m=table.stacked(_SIZE),
        yaw_rad=yaw_rad,
        velocity_mps=centred_velocities(table["id"], table["stamp_ns"], centre_m),
        num_points=np.full(len(table), -1),
        interpolated=np.zeros(len(table), dtype=bool),
    )


def read_detections_csv(path: Path, poses: Mapping[int, Pose]) -> DetectionTable:
    """Return the detections in the world.

    Raises:
        DataError: a broken line, a value out of range, or a stamp without a pose.
    """
    table = _in_frames(read_text_columns(path, _DETECTED, separator=",", header=True), poses)
    centre_m, yaw_rad = to_world(
        table.stacked(_PLACE), table["yaw"], table["frame"], list(poses.values())
    )
    size_m = table.stacked(_SIZE)
    return DetectionTable(table["frame"], table["label"], table["score"], centre_m, size_m, yaw_rad)


def _in_frames(table: Columns, poses: Mapping[int, Pose]) -> Columns:
    """Return the rows, checked and sorted by frame, with the index of their frame."""
    check_sizes(table, *_SIZE)
    check_ego_places(table, *_PLACE)
    check_headings(table, "yaw")
    table.refuse("label", table["label"] == "", "a name")
    frame = frames_at(table["stamp_ns"], list(poses))
    table.refuse("stamp_ns", frame < 0, "a stamp of poses.csv")
    order = np.argsort(frame, kind="stable")
    return table.select(order).extended(frame=frame[order])
