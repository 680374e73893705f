"""From the tables to scene records: each table is streamed once, only what is needed stays.

Of the thirteen tables nine are read (`TABLES`), and of the millions of records of sample_data and
ego_pose those of LIDAR_TOP in the chosen scenes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import DataError
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.datasets.checks import check_rotations, check_sizes, check_world_places
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import MissingError, OutOfOrderError
from mottrack.formats.nuscenes_tables import (
    ROTATION,
    TOKEN,
    TRANSLATION,
    NuScenesTables,
    RecordFilter,
    looked_up,
    text_of,
)

TABLES = (
    "scene",
    "sample",
    "sensor",
    "calibrated_sensor",
    "sample_data",
    "ego_pose",
    "category",
    "instance",
    "sample_annotation",
)
CHANNEL = "LIDAR_TOP"
LATEST_US = np.iinfo(np.int64).max // 1000
"""The last microsecond that nanoseconds of 64 bits can hold."""
_SAMPLE_TOKEN = ColumnSpec("sample_token", str)
_SAMPLE = (TOKEN, ColumnSpec("timestamp", int), ColumnSpec("scene_token", str))
_SAMPLE_DATA = (
    _SAMPLE_TOKEN,
    ColumnSpec("ego_pose_token", str),
    ColumnSpec("calibrated_sensor_token", str),
    ColumnSpec("timestamp", int),
    ColumnSpec("is_key_frame", int),
    ColumnSpec("filename", str),
)
# fields of sample_annotation that are read
_ANNOTATION = (
    TOKEN,
    _SAMPLE_TOKEN,
    ColumnSpec("instance_token", str),
    TRANSLATION,
    ColumnSpec("size", width=3),
    ROTATION,
    ColumnSpec("num_lidar_pts", int),
    ColumnSpec("num_radar_pts", int),
)


@dataclass(frozen=True)
class SceneRecord:
    """K key frames, S sweeps of LIDAR_TOP in order of time, B annotated boxes.

    Text is kept as bytes (UTF-8). Poses are quaternions w, x, y, z, then x, y, z in metres.

    sample_token: (K,).
    sweep_stamp_us: (S,). sweep_file: (S,) relative to the root.
    sweep_sample: (S,) the key frame that a sweep is, -1 between key frames.
    world_T_ego: (S, 7) at each sweep. ego_T_lidar: (S, 7).
    box_sample: (B,) key frame of each box, ascending. box_instance: (B,) identity.
    box_category: (B,) official category. box_centre_m: (B, 3) in the world.
    box_size_wlh_m: (B, 3). box_rotation: (B, 4) wxyz. box_points: (B,) LiDAR + radar returns.
    annotated: (1,) whether the tables hold annotations at all (the test split's do not).
    """

    sample_token: NDArray[np.bytes_]
    sweep_stamp_us: I64
    sweep_file: NDArray[np.bytes_]
    sweep_sample: I64
    world_T_ego: F64
    ego_T_lidar: F64
    box_sample: I64
    box_instance: I64
    box_category: NDArray[np.bytes_]
    box_centre_m: F64
    box_size_wlh_m: F64
    box_rotation: F64
    box_points: I64
    annotated: Mask

    def save(self, path: Path) -> None:
        """Store with a checksum."""
        write_arrays(path, {f.name: getattr(self, f.name) for f in fields(self)})

    @classmethod
    def load(cls, path: Path) -> SceneRecord:
        """Read what `save` wrote.

        Raises:
            ResultError: missing or damaged.
        """
        return cls(**read_arrays(path))


@dataclass(frozen=True)
class _Samples:
    """The key frames of the chosen scenes, sorted by scene and time.

    token: (K,). scene: (K,) ascending index of the scene. index: place of each token.
    """

    token: NDArray[np.bytes_]
    scene: I64
    index: dict[str, int]


def build_records(tables: NuScenesTables, names: tuple[str, ...]) -> dict[str, SceneRecord]:
    """Return the record of each of these scenes.

    Raises:
        DataError: a table is missing or damaged, or a record points to one that is not there.
    """
    tokens = tables.scene_tokens()
    samples = _samples(tables, {tokens[name]: i for i, name in enumerate(names)})
    sweeps = _all_sweeps(tables, samples.index)
    boxes = _all_boxes(tables, samples.index)
    annotated = len(boxes) > 0 or next(tables.rows("sample_annotation"), None) is not None
    records = {}
    for scene, name in enumerate(names):
        first, end = (int(i) for i in np.searchsorted(samples.scene, [scene, scene + 1]))
        sample_token = samples.token[first:end]
        records[name] = SceneRecord(
            sample_token=sample_token,
            annotated=np.array([annotated]),
            **_sweep_arrays(tables, _between(sweeps, first, end), sample_token),
            **_box_arrays(_between(boxes, first, end)),
        )
    return records


def _samples(tables: NuScenesTables, scene_index: dict[str, int]) -> _Samples:
    columns = tables.columns("sample", _SAMPLE, RecordFilter({"scene_token": scene_index}))
    scene = looked_up(columns["scene_token"], scene_index)
    order = np.lexsort((columns["timestamp"], scene))
    columns.refuse_repeated("token", columns["token"], "each token once")
    token = columns["token"][order]
    return _Samples(token, scene[order], {name: i for i, name in enumerate(text_of(token))})


def _all_sweeps(tables: NuScenesTables, sample_index: dict[str, int]) -> Columns:
    """Return the LIDAR_TOP records of sample_data, sorted by sample.

    They gain `sample` (its index), `world_T_ego` and `ego_T_lidar` (S, 7).
    """
    mounts = _lidar_mounts(tables)
    among = RecordFilter({"calibrated_sensor_token": mounts, "sample_token": sample_index})
    columns = tables.columns("sample_data", _SAMPLE_DATA, among)
    sample = looked_up(columns["sample_token"], sample_index)
    mount = [mounts[token] for token in text_of(columns["calibrated_sensor_token"])]
    return columns.extended(
        sample=sample,
        ego_T_lidar=np.array(mount).reshape(-1, 7),
        world_T_ego=_ego_poses(tables, columns["ego_pose_token"]),
    ).select(np.argsort(sample, kind="stable"))


def _lidar_mounts(tables: NuScenesTables) -> dict[str, F64]:
    """Return `ego_T_lidar` (7,) of each calibrated LIDAR_TOP."""
    sensors = tables.columns("sensor", (TOKEN, ColumnSpec("channel", str)))
    lidars = set(text_of(sensors["token"][sensors["channel"] == CHANNEL.encode()]))
    if not lidars:
        raise MissingError(sensors.path, "channel", "missing", CHANNEL)
    among = RecordFilter({"sensor_token": lidars})
    mounts = tables.columns("calibrated_sensor", (TOKEN, ROTATION, TRANSLATION), among)
    return dict(zip(text_of(mounts["token"]), _checked_poses(mounts), strict=True))


def _ego_poses(tables: NuScenesTables, tokens: NDArray[np.bytes_]) -> F64:
    # several sweeps may share a pose, so look up by token both ways
    wanted = {token: place for place, token in enumerate(dict.fromkeys(text_of(tokens)))}
    among = RecordFilter({"token": wanted})
    found = tables.columns("ego_pose", (TOKEN, ROTATION, TRANSLATION), among)
    poses = np.full((len(wanted), 7), np.nan)
    poses[looked_up(found["token"], wanted)] = _checked_poses(found)
    for token, place in wanted.items():
        if np.isnan(poses[place, 0]):
            raise MissingError(found.path, "record", "missing", f"ego pose {token}")
    return poses[looked_up(tokens, wanted)]


def _checked_poses(columns: Columns) -> F64:
    """Return rotation and translation side by side, (N, 7)."""
    check_rotations(columns)
    check_world_places(columns)
    return np.hstack([columns["rotation"], columns["translation"]])


def _all_boxes(tables: NuScenesTables, sample_index: dict[str, int]) -> Columns:
    """Return the annotations of the samples, sorted by sample, else in the order of the table.

    They gain `sample` (its index), `instance` (numbered) and `category` (its name).
    """
    among = RecordFilter({"sample_token": sample_index})
    columns = tables.columns("sample_annotation", _ANNOTATION, among)
    _checked_poses(columns)
    check_sizes(columns, "size")
    for name in ("num_lidar_pts", "num_radar_pts"):
        columns.refuse(name, columns[name] < 0, "0 or more")
    sample = looked_up(columns["sample_token"], sample_index)
    instances = text_of(columns["instance_token"])
    number = {token: i for i, token in enumerate(dict.fromkeys(instances))}
    instance = looked_up(columns["instance_token"], number)
    keys = np.column_stack([sample, instance])
    columns.refuse_repeated("instance_token", keys, "each instance once a sample")
    category = _categories(tables, number)[instance] if number else np.zeros(0, np.bytes_)
    columns = columns.extended(sample=sample, instance=instance, category=category)
    return columns.select(np.argsort(sample, kind="stable"))


def _categories(tables: NuScenesTables, number: dict[str, int]) -> NDArray[np.bytes_]:
    """Return the category's name of each instance."""
    names = tables.columns("category", (TOKEN, ColumnSpec("name", str)))
    name_of = dict(zip(text_of(names["token"]), names["name"], strict=True))
    specs = (TOKEN, ColumnSpec("category_token", str))
    found = tables.columns("instance", specs, RecordFilter({"token": number}))
    category_of = dict(zip(text_of(found["token"]), text_of(found["category_token"]), strict=True))
    for token in number:
        if token not in category_of:
            raise MissingError(found.path, "record", "missing", f"instance {token}")
        if category_of[token] not in name_of:
            expected = f"category {category_of[token]}"
            raise MissingError(names.path, "record", "missing", expected)
    return np.array([name_of[category_of[token]] for token in number], dtype=np.bytes_)


def _between(columns: Columns, first: int, end: int) -> Columns:
    """Return the rows of the samples first .. end - 1, counted from the first."""
    own = columns.select(np.arange(*np.searchsorted(columns["sample"], [first, end])))
    return own.extended(sample=own["sample"] - first)


def _sweep_arrays(
    tables: NuScenesTables, sweeps: Columns, sample_token: NDArray[np.bytes_]
) -> dict[str, NDArray[Any]]:
    # a sweep between key frames belongs to one of its neighbours: sort by time, not by sample
    sweeps = sweeps.select(np.argsort(sweeps["timestamp"], kind="stable"))
    _check_times(sweeps.path, sweeps["timestamp"])
    key = sweeps["is_key_frame"].astype(bool)
    if not len(sample_token):
        raise DataError(tables.path("sample"), "samples of a scene", 0, "at least one")
    _check_key_frames(sweeps.path, sweeps["sample"][key], sample_token)
    return {
        "sweep_stamp_us": sweeps["timestamp"],
        "sweep_file": sweeps["filename"],
        "sweep_sample": np.where(key, sweeps["sample"], -1),
        "world_T_ego": sweeps["world_T_ego"],
        "ego_T_lidar": sweeps["ego_T_lidar"],
    }


def _check_times(path: Path, stamp_us: I64) -> None:
    """Refuse (S,) sorted times that nanoseconds of 64 bits can't hold, or that come twice."""
    wrong = stamp_us[(stamp_us < 0) | (stamp_us > LATEST_US)]
    if wrong.size:
        raise DataError(path, "timestamp", int(wrong[0]), f"microseconds, 0 to {LATEST_US}")
    repeated = np.flatnonzero(np.diff(stamp_us) <= 0)
    if repeated.size:
        raise OutOfOrderError(path, "timestamp", f"{stamp_us[repeated[0]]} twice", "each once")


def _check_key_frames(path: Path, keyed: I64, sample_token: NDArray[np.bytes_]) -> None:
    """Refuse a sample that is not marked as the key frame of exactly one sweep."""
    count = np.bincount(keyed, minlength=len(sample_token))
    wrong = np.flatnonzero(count != 1)
    if wrong.size:
        field = f"{CHANNEL} key frames of sample {sample_token[wrong[0]].decode()}"
        raise MissingError(path, field, int(count[wrong[0]]), "1")


def _box_arrays(boxes: Columns) -> dict[str, NDArray[Any]]:
    return {
        "box_sample": boxes["sample"],
        "box_instance": np.unique(boxes["instance"], return_inverse=True)[1],
        "box_category": boxes["category"],
        "box_centre_m": boxes["translation"],
        "box_size_wlh_m": boxes["size"],
        "box_rotation": boxes["rotation"],
        "box_points": boxes["num_lidar_pts"] + boxes["num_radar_pts"],
    }
