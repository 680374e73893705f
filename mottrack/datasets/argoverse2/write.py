"""Write any scenes as an Argoverse 2 sensor data set."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather

from mottrack.core import Frame, Objects, Pose, Scene, Sweep, Truth
from mottrack.core.arrays import F64, Texts
from mottrack.core.storage import write_bytes
from mottrack.datasets.argoverse2.config import CLASS_MAP
from mottrack.datasets.argoverse2.dataset import POSES
from mottrack.datasets.argoverse2.log_files import (
    INTENSITY_MAX,
    ROTATION,
    SIZE,
    TRANSLATION,
    UP_LIDAR,
)
from mottrack.datasets.counting import counted_points
from mottrack.formats.rigid import quaternion_wxyz, yaw_quaternions

_ARGOVERSE = {category: label for category, label in CLASS_MAP.items() if category.isupper()}
CATEGORY_OF = {label: category for category, label in reversed(_ARGOVERSE.items())} | {
    "truck": "TRUCK"
}
"""Label to Argoverse category: the first in the table, but for trucks."""
_POSE = (*ROTATION, *TRANSLATION)
_CUBOID = (*SIZE, *_POSE)
DETECTIONS = "detections.feather"


def write_argoverse2(scenes: Iterable[Scene], root: Path) -> tuple[str, ...]:
    """Write `val/<scene>/` for each scene and `detections.feather`; return the names.

    Points are stored as float16, as Argoverse does: 3 cm at 50 m.
    """
    names = []
    detections: list[pa.Table] = []
    for scene in scenes:
        names.append(scene.name)
        detections.extend(_write_log(scene, root / "val" / scene.name))
    if detections:
        _save(pa.concat_tables(detections), root / DETECTIONS)
    return tuple(names)


def _write_log(scene: Scene, folder: Path) -> list[pa.Table]:
    """Write one log; return its detections."""
    frames = [scene.frame(index) for index in range(len(scene))]
    origin = np.zeros(3)
    annotations = []
    for index, frame in enumerate(frames):
        sweep = scene.sweep(index) if scene.has_sweeps else None
        if sweep is not None:
            origin = sweep.origin_m
            _save(_points(sweep), folder / "sensors" / "lidar" / f"{frame.stamp_ns}.feather")
        if frame.truth is not None:
            annotations.append(_annotations(frame, frame.truth, sweep))
    if annotations:
        _save(pa.concat_tables(annotations), folder / "annotations.feather")
    _save(_poses(frames), folder / POSES)
    _save(_mounting(origin), folder / "calibration" / "egovehicle_SE3_sensor.feather")
    return [
        _detections(scene.name, frame, frame.detections)
        for frame in frames
        if frame.detections is not None and len(frame.detections)
    ]


def _points(sweep: Sweep) -> pa.Table:
    count = len(sweep)
    ring = np.zeros(count) if sweep.ring is None else sweep.ring
    offset = np.zeros(count) if sweep.time_offset_ns is None else sweep.time_offset_ns
    columns = {axis: sweep.xyz_m[:, i].astype(np.float16) for i, axis in enumerate("xyz")}
    columns["intensity"] = np.round(sweep.reflectance * INTENSITY_MAX).astype(np.uint8)
    columns["laser_number"] = ring.astype(np.uint8)
    columns["offset_ns"] = offset.astype(np.int32)
    return pa.table(columns)


def _annotations(frame: Frame, truth: Truth, sweep: Sweep | None) -> pa.Table:
    return pa.table(
        {
            "timestamp_ns": np.full(len(truth), frame.stamp_ns),
            "track_uuid": pa.array([f"{number:08d}" for number in truth.id], pa.string()),
            "category": categories(truth.label),
            **_cuboids(truth, frame),
            "num_interior_pts": counted_points(truth, sweep),
        }
    )


def _detections(log: str, frame: Frame, found: Objects) -> pa.Table:
    return pa.table(
        {
            "timestamp_ns": np.full(len(found), frame.stamp_ns),
            "log_id": pa.array([log] * len(found), pa.string()),
            "category": categories(found.label),
            **_cuboids(found, frame),
            "score": found.score,
        }
    )


def categories(labels: Texts) -> pa.Array:
    """Return the Argoverse category of each label, as text."""
    names = [CATEGORY_OF.get(str(label), str(label).upper()) for label in labels]
    return pa.array(names, pa.string())


def _cuboids(boxes: Truth | Objects, frame: Frame) -> dict[str, F64]:
    ego = boxes.transformed(frame.world_T_ego.inverse(), "ego")
    values = np.hstack([ego.size_m, yaw_quaternions(ego.yaw_rad), ego.centre_m])
    return {name: values[:, i] for i, name in enumerate(_CUBOID)}


def _poses(frames: list[Frame]) -> pa.Table:
    values = np.array([_pose_row(frame.world_T_ego) for frame in frames])
    stamps = {"timestamp_ns": [frame.stamp_ns for frame in frames]}
    return pa.table(stamps | {name: values[:, i] for i, name in enumerate(_POSE)})


def _pose_row(pose: Pose) -> F64:
    return np.concatenate([quaternion_wxyz(pose.rotation), pose.translation_m])


def _mounting(origin_m: F64) -> pa.Table:
    values = np.concatenate([[1.0, 0.0, 0.0, 0.0], origin_m])
    columns = {name: [value] for name, value in zip(_POSE, values, strict=True)}
    return pa.table({"sensor_name": [UP_LIDAR]} | columns)


def _save(table: pa.Table, path: Path) -> None:
    sink = pa.BufferOutputStream()
    pyarrow.feather.write_feather(table, sink)
    write_bytes(path, sink.getvalue().to_pybytes())
