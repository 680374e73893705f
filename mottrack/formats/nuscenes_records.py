"""From the tables to scene records: each table is streamed once, only what is needed stays.

Of the thirteen tables nine are read (`TABLES`), and of the millions of records of sample_data and
ego_pose those of the LiDARs in the chosen scenes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import DataError
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import MissingError, OutOfOrderError
from mottrack.formats.nuscenes_boxes import box_arrays, read_boxes
from mottrack.formats.nuscenes_links import LINKS, check_links, check_stamps, checked_poses
from mottrack.formats.nuscenes_tables import (
    ROTATION,
    TOKEN,
    TRANSLATION,
    NuScenesTables,
    looked_up,
    scene_tokens,
    text_of,
)
from mottrack.formats.table_stream import RecordFilter

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


class Channels(NamedTuple):
    """The LiDARs of a data set.

    main: names that the LiDAR has whose sweeps are the frames; the first that is there counts.
    further: LiDARs beside it, in the order of `SceneRecord.part_channel`.
    """

    main: tuple[str, ...]
    further: tuple[str, ...] = ()


LIDAR_TOP = Channels((CHANNEL,))
MAX_KEY_OFFSET_US = 250_000
"""A sample has the time of its LiDAR sweep; by half the period it would be the next one's."""
_SCENE = (TOKEN, ColumnSpec("name", str), ColumnSpec("nbr_samples", int))
_SAMPLE_TOKEN = ColumnSpec("sample_token", str)
_SAMPLE = (TOKEN, ColumnSpec("timestamp", int), ColumnSpec("scene_token", str), *LINKS)
_SAMPLE_DATA = (
    TOKEN,
    *LINKS,
    _SAMPLE_TOKEN,
    ColumnSpec("ego_pose_token", str),
    ColumnSpec("calibrated_sensor_token", str),
    ColumnSpec("timestamp", int),
    ColumnSpec("is_key_frame", int),
    ColumnSpec("filename", str),
)


@dataclass(frozen=True)
class SceneRecord:
    """K key frames, S sweeps of the LiDAR in order of time, B annotated boxes.

    Text is kept as bytes (UTF-8). Poses are quaternions w, x, y, z, then x, y, z in metres.

    sample_token: (K,). sample_stamp_us: (K,) ascending.
    sweep_stamp_us: (S,). sweep_file: (S,) relative to the root.
    sweep_sample: (S,) the key frame that a sweep is, -1 between key frames.
    world_T_ego: (S, 7) at each sweep. ego_T_lidar: (S, 7).
    box_sample: (B,) key frame of each box, ascending. box_instance: (B,) identity.
    box_category: (B,) official category. box_centre_m: (B, 3) in the world.
    box_size_wlh_m: (B, 3). box_rotation: (B, 4) wxyz. box_points: (B,) LiDAR + radar returns.
    annotated: (1,) whether the tables hold annotations at all (the test split's do not).

    P sweeps of further LiDARs, in order of time, where the data set has such:
    part_stamp_us: (P,). part_file: (P,). part_channel: (P,) which of them.
    part_world_T_ego: (P, 7) at each of these sweeps. part_ego_T_lidar: (P, 7).
    """

    sample_token: NDArray[np.bytes_]
    sample_stamp_us: I64
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
    part_stamp_us: I64
    part_file: NDArray[np.bytes_]
    part_channel: I64
    part_world_T_ego: F64
    part_ego_T_lidar: F64

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

    token: (K,). stamp_us: (K,). scene: (K,) ascending index of the scene. index: place of each
    token. every: tokens of all samples, of other scenes too.
    """

    token: NDArray[np.bytes_]
    stamp_us: I64
    scene: I64
    index: dict[str, int]
    every: frozenset[str]


class _KeyFrames(NamedTuple):
    """The key frames of one scene in order of time: tokens (K,), microseconds (K,), their LiDAR."""

    token: NDArray[np.bytes_]
    stamp_us: I64
    channel: str


def build_records(
    tables: NuScenesTables,
    names: tuple[str, ...],
    *,
    channels: Channels = LIDAR_TOP,
    key_frames_only: bool = False,
) -> dict[str, SceneRecord]:
    """Return the record of each of these scenes.

    Args:
        tables: the tables of a version.
        names: the scenes.
        channels: the LiDARs.
        key_frames_only: leave out the sweeps between key frames, for which an evaluation has no
            use, and with them most of the time.

    Raises:
        DataError: a table is missing or damaged, a record points to one that is not there, or
            records that others speak of are missing.
    """
    scenes = tables.columns("scene", _SCENE)
    samples = _samples(tables, scenes, names)
    mounts = _lidar_mounts(tables, channels)
    sweeps = _all_sweeps(tables, samples, mounts, key_frames_only)
    boxes = read_boxes(tables, samples.index, samples.every)
    records = {}
    for scene, name in enumerate(names):
        first, end = (int(i) for i in np.searchsorted(samples.scene, [scene, scene + 1]))
        own = _KeyFrames(samples.token[first:end], samples.stamp_us[first:end], mounts.main)
        every = _between(sweeps, first, end)
        records[name] = SceneRecord(
            sample_token=own.token,
            sample_stamp_us=own.stamp_us,
            annotated=np.array([boxes.annotated]),
            **_sweep_arrays(every.select(every["channel"] < 0), own, linked=not key_frames_only),
            **_part_arrays(every.select(every["channel"] >= 0)),
            **box_arrays(_between(boxes.table, first, end)),
        )
    return records


def _samples(tables: NuScenesTables, scenes: Columns, names: tuple[str, ...]) -> _Samples:
    """Return the key frames of the named scenes, as many as each scene's record says."""
    tokens, token_of = text_of(scenes["token"]), scene_tokens(scenes)
    scene_index = {token_of[name]: i for i, name in enumerate(names)}
    every = tables.columns("sample", _SAMPLE, RecordFilter(known={"scene_token": set(tokens)}))
    columns = every.select(np.isin(every["scene_token"], [t.encode() for t in scene_index]))
    scene = looked_up(columns["scene_token"], scene_index)
    order = np.lexsort((columns["timestamp"], scene))
    columns, scene = columns.select(order), scene[order]
    check_stamps(columns, "timestamp")
    found = np.bincount(scene, minlength=len(names))
    expected = dict(zip(tokens, scenes["nbr_samples"].tolist(), strict=True))
    for scene_token, place in scene_index.items():
        wanted = expected[scene_token]
        if found[place] != wanted:
            path, field = tables.path("sample"), f"samples of {names[place]}"
            raise MissingError(path, field, int(found[place]), f"{wanted} (nbr_samples)")
    check_links(columns, scene)
    token = columns["token"]
    return _Samples(
        token,
        columns["timestamp"],
        scene,
        {name: i for i, name in enumerate(text_of(token))},
        frozenset(text_of(every["token"])),
    )


def _all_sweeps(
    tables: NuScenesTables, samples: _Samples, mounts: _Mounts, key_frames_only: bool
) -> Columns:
    """Return the LiDAR records of sample_data, sorted by sample.

    They gain `sample` (its index), `channel`, `world_T_ego` and `ego_T_lidar` (S, 7).
    """
    among = RecordFilter(
        {"calibrated_sensor_token": mounts.pose, "sample_token": samples.index},
        {"calibrated_sensor_token": mounts.every, "sample_token": samples.every},
    )
    columns = tables.columns("sample_data", _SAMPLE_DATA, among)
    if key_frames_only:
        columns = columns.select(columns["is_key_frame"] != 0)
    sample = looked_up(columns["sample_token"], samples.index)
    tokens = text_of(columns["calibrated_sensor_token"])
    mount = [mounts.pose[token] for token in tokens]
    return columns.extended(
        sample=sample,
        channel=np.array([mounts.channel[token] for token in tokens], dtype=np.int64),
        ego_T_lidar=np.array(mount).reshape(-1, 7),
        world_T_ego=_ego_poses(tables, columns["ego_pose_token"]),
    ).select(np.argsort(sample, kind="stable"))


class _Mounts(NamedTuple):
    """Mountings of the LiDARs by token.

    pose: `ego_T_lidar` (7,). channel: -1 for the main one, else which of the further ones.
    every: the tokens of all mountings. main: name of the main LiDAR.
    """

    pose: dict[str, F64]
    channel: dict[str, int]
    every: frozenset[str]
    main: str


def _lidar_mounts(tables: NuScenesTables, channels: Channels) -> _Mounts:
    sensors = tables.columns("sensor", (TOKEN, ColumnSpec("channel", str)))
    names = text_of(sensors["channel"])
    main = next((name for name in channels.main if name in names), None)
    if main is None:
        raise MissingError(sensors.path, "channel", "missing", " or ".join(channels.main))
    wanted = {main: -1} | {name: i for i, name in enumerate(channels.further)}
    lidar = np.isin(sensors["channel"], [name.encode() for name in wanted])
    known = {"sensor_token": set(text_of(sensors["token"]))}
    specs = (TOKEN, ROTATION, TRANSLATION, ColumnSpec("sensor_token", str))
    mounts = tables.columns("calibrated_sensor", specs, RecordFilter(known=known))
    own = mounts.select(np.isin(mounts["sensor_token"], sensors["token"][lidar]))
    tokens = text_of(own["token"])
    pose = dict(zip(tokens, checked_poses(own), strict=True))
    number = dict(zip(text_of(sensors["token"]), (wanted.get(n, -1) for n in names), strict=True))
    channel = {t: number[s] for t, s in zip(tokens, text_of(own["sensor_token"]), strict=True)}
    return _Mounts(pose, channel, frozenset(text_of(mounts["token"])), main)


def _ego_poses(tables: NuScenesTables, tokens: NDArray[np.bytes_]) -> F64:
    # several sweeps may share a pose, so look up by token both ways
    wanted = {token: place for place, token in enumerate(dict.fromkeys(text_of(tokens)))}
    among = RecordFilter({"token": wanted})
    found = tables.columns("ego_pose", (TOKEN, ROTATION, TRANSLATION), among)
    poses = np.full((len(wanted), 7), np.nan)
    poses[looked_up(found["token"], wanted)] = checked_poses(found)
    for token, place in wanted.items():
        if np.isnan(poses[place, 0]):
            raise MissingError(found.path, "record", "missing", f"ego pose {token}")
    return poses[looked_up(tokens, wanted)]


def _between(columns: Columns, first: int, end: int) -> Columns:
    """Return the rows of the samples first .. end - 1, counted from the first."""
    own = columns.select(np.arange(*np.searchsorted(columns["sample"], [first, end])))
    return own.extended(sample=own["sample"] - first)


def _part_arrays(parts: Columns) -> dict[str, NDArray[Any]]:
    """Return what a scene's record keeps of the sweeps of further LiDARs."""
    parts = parts.select(np.argsort(parts["timestamp"], kind="stable"))
    check_stamps(parts, "timestamp")
    return {
        "part_stamp_us": parts["timestamp"],
        "part_file": parts["filename"],
        "part_channel": parts["channel"],
        "part_world_T_ego": parts["world_T_ego"],
        "part_ego_T_lidar": parts["ego_T_lidar"],
    }


def _sweep_arrays(sweeps: Columns, samples: _KeyFrames, *, linked: bool) -> dict[str, NDArray[Any]]:
    # a sweep between key frames belongs to one of its neighbours: sort by time, not by sample
    sweeps = sweeps.select(np.argsort(sweeps["timestamp"], kind="stable"))
    check_stamps(sweeps, "timestamp")
    repeated = np.diff(sweeps["timestamp"], prepend=-1) <= 0
    sweeps.refuse("timestamp", repeated, "each time once", OutOfOrderError)
    if linked:
        check_links(sweeps, np.zeros(len(sweeps), np.int64))
    sweeps.refuse("is_key_frame", ~np.isin(sweeps["is_key_frame"], (0, 1)), "true or false")
    key = sweeps["is_key_frame"].astype(bool)
    if not len(samples.token):
        raise DataError(
            sweeps.path.with_name("sample.json"), "samples of a scene", 0, "at least one"
        )
    _check_key_frames(sweeps.select(key), samples)
    return {
        "sweep_stamp_us": sweeps["timestamp"],
        "sweep_file": sweeps["filename"],
        "sweep_sample": np.where(key, sweeps["sample"], -1),
        "world_T_ego": sweeps["world_T_ego"],
        "ego_T_lidar": sweeps["ego_T_lidar"],
    }


def _check_key_frames(keys: Columns, samples: _KeyFrames) -> None:
    """Refuse a sample that is not the key frame of exactly one sweep, or of one at another time."""
    count = np.bincount(keys["sample"], minlength=len(samples.token))
    wrong = np.flatnonzero(count != 1)
    if wrong.size:
        field = f"{samples.channel} key frames of sample {samples.token[wrong[0]].decode()}"
        raise MissingError(keys.path, field, int(count[wrong[0]]), "1")
    offset_us = np.abs(keys["timestamp"] - samples.stamp_us[keys["sample"]])
    keys.refuse("timestamp", offset_us > MAX_KEY_OFFSET_US, "that of its sample", OutOfOrderError)
