"""The files of an own log: poses, labelled boxes, detections and sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import DataError, InputError, Pose, Sweep, TruthTable
from mottrack.core.npz import unpacked_npz
from mottrack.datasets.fitted_velocity import box_velocities
from mottrack.datasets.scene_boxes import (
    DetectionTable,
    frames_at,
    to_world,
    unknown_velocities,
)
from mottrack.formats.checks import (
    check_ego_places,
    check_headings,
    check_interval,
    check_points,
    check_sizes,
    read_float_rows,
)
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.faults import OutOfOrderError
from mottrack.formats.files import present, read_bytes
from mottrack.formats.rigid import quaternion_pose
from mottrack.formats.text_rows import Layout, read_text_columns

CSV = Layout(",", header=True)
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
    table = read_text_columns(path, _POSE, CSV)
    stamps = table["stamp_ns"].tolist()
    rotation, place = table.stacked(_ROTATION), table.stacked(_PLACE)
    poses = {}
    for i, (line, stamp) in enumerate(zip(table.row, stamps, strict=True)):
        if i and stamp <= stamps[i - 1]:
            expected = f"later than {stamps[i - 1]}"
            raise OutOfOrderError(path, f"line {line}, stamp_ns", stamp, expected)
        poses[stamp] = quaternion_pose(rotation[i], place[i], path, f"line {line}, pose")
    return poses


def read_boxes_csv(path: Path, poses: Mapping[int, Pose], *, fitted: bool) -> TruthTable:
    """Return the labelled boxes in the world; velocities follow from positions (`box_velocities`).

    Raises:
        DataError: a broken line, a value out of range, a stamp without a pose, or an identity twice
            at one stamp.
    """
    table = _in_frames(read_text_columns(path, _LABELLED, CSV), poses)
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
        velocity_mps=box_velocities(table["id"], table["stamp_ns"], centre_m, fitted=fitted),
        num_points=np.full(len(table), -1),
        interpolated=np.zeros(len(table), dtype=bool),
    )


def read_detections_csv(path: Path, poses: Mapping[int, Pose]) -> DetectionTable:
    """Return the detections in the world.

    Raises:
        DataError: a broken line, a value out of range, or a stamp without a pose.
    """
    table = _in_frames(read_text_columns(path, _DETECTED, CSV), poses)
    centre_m, yaw_rad = to_world(
        table.stacked(_PLACE), table["yaw"], table["frame"], list(poses.values())
    )
    return DetectionTable(
        frame=table["frame"],
        label=table["label"],
        score=table["score"],
        centre_m=centre_m,
        size_m=table.stacked(_SIZE),
        yaw_rad=yaw_rad,
        velocity_mps=unknown_velocities(len(table)),
    )


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


def sweep_file(folder: Path, stamp_ns: int) -> Path:
    """Return the npz of a stamp where there is one, else the bin."""
    npz = folder / f"{stamp_ns}.npz"
    return npz if present(npz) else folder / f"{stamp_ns}.bin"


def is_lost(path: Path) -> bool:
    """Return whether a sweep was not recorded: its file is not there, or of no bytes."""
    return not present(path) or (path.is_file() and path.stat().st_size == 0)


def read_sweep(path: Path, stamp_ns: int, world_T_ego: Pose, origin_m: Sequence[float]) -> Sweep:
    """Read one sweep; `origin_m` (3,) is the LiDAR's optical centre in the ego frame.

    One of no points is a lost sweep.

    Raises:
        DataError: missing or damaged file, a value that is not finite or out of range.
    """
    arrays = _npz(path) if path.suffix == ".npz" else _bin(path)
    if not len(arrays["xyz_m"]):
        return Sweep.lost(stamp_ns, world_T_ego)
    check_points(path, arrays["xyz_m"])
    check_interval(path, "reflectance", arrays["reflectance"], 1.0)
    try:
        return Sweep(
            stamp_ns=stamp_ns, world_T_ego=world_T_ego, origin_m=np.array(origin_m), **arrays
        )
    except InputError as error:
        raise DataError(path, error.field, error.value, error.expected) from error


def _bin(path: Path) -> dict[str, NDArray[Any]]:
    values = read_float_rows(path, 4)
    return {"xyz_m": values[:, :3], "reflectance": values[:, 3]}


def _npz(path: Path) -> dict[str, NDArray[Any]]:
    data = read_bytes(path)
    try:
        arrays = unpacked_npz(data, ("xyz_m", "reflectance", "time_offset_ns", "ring"))
    except ValueError as error:
        raise DataError(path, "content", error, "an npz file") from error
    for name, dimensions in (("xyz_m", 2), ("reflectance", 1)):
        array = arrays.get(name)
        if array is None or array.ndim != dimensions or array.dtype.kind not in "fiu":
            found = "missing" if array is None else f"{array.dtype} {array.shape}"
            raise DataError(path, name, found, "xyz_m (N, 3) and reflectance (N,) numbers")
    if arrays["xyz_m"].shape[1] != 3 or len(arrays["xyz_m"]) != len(arrays["reflectance"]):
        shapes = f"{arrays['xyz_m'].shape}, {arrays['reflectance'].shape}"
        raise DataError(path, "shapes", shapes, "(N, 3), (N,)")
    return arrays
