"""From the tables to scene records: each table is streamed once, only what is needed stays.

Of the thirteen tables nine are read (scene, sample, sensor, calibrated_sensor, sample_data,
ego_pose, category, instance, sample_annotation), and of the millions of records of sample_data and
ego_pose those of LIDAR_TOP in the chosen scenes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import I64
from mottrack.core.errors import DataError
from mottrack.datasets.faults import MissingError, OutOfOrderError
from mottrack.datasets.nuscenes.annotations import box_columns
from mottrack.datasets.nuscenes.columns import Kind
from mottrack.datasets.nuscenes.record import SceneRecord
from mottrack.datasets.nuscenes.sweep_table import sweep_columns
from mottrack.datasets.nuscenes.tables import TOKEN, Columns, Rows, Tables, text_of

LATEST_US = np.iinfo(np.int64).max // 1000


@dataclass(frozen=True)
class Samples:
    """The key frames of the chosen scenes, sorted by scene and time.

    token: (K,). scene: (K,) ascending index of the scene. index: place of each token.
    """

    token: NDArray[np.bytes_]
    scene: I64
    index: dict[str, int]


def build_records(tables: Tables, names: tuple[str, ...]) -> dict[str, SceneRecord]:
    """Return the record of each of these scenes.

    Raises:
        DataError: a table is missing or damaged, or a record points to one that is not there.

    """
    tokens = tables.scene_tokens()
    samples = _samples(tables, {tokens[name]: i for i, name in enumerate(names)})
    sweeps = sweep_columns(tables, samples.index)
    boxes = box_columns(tables, samples.index)
    records = {}
    for scene, name in enumerate(names):
        first, end = (int(i) for i in np.searchsorted(samples.scene, [scene, scene + 1]))
        records[name] = SceneRecord(
            sample_token=samples.token[first:end],
            annotated=np.array([boxes is not None]),
            **_sweeps(tables, _between(sweeps, first, end), samples.token[first:end]),
            **_boxes(_between(boxes or {}, first, end)),
        )
    return records


def _samples(tables: Tables, scene_index: dict[str, int]) -> Samples:
    kinds = (TOKEN, Kind("timestamp", integer=True), Kind("scene_token", text=True))
    columns = tables.columns("sample", kinds, Rows({"scene_token": scene_index}))
    scene = np.array([scene_index[t] for t in text_of(columns["scene_token"])], dtype=np.int64)
    order = np.lexsort((columns["timestamp"], scene))
    token = columns["token"][order]
    index = {name: place for place, name in enumerate(text_of(token))}
    if len(index) != len(token):
        raise OutOfOrderError(tables.path("sample"), "token", "repeated", "each token once")
    return Samples(token, scene[order], index)


def _between(columns: Columns, first: int, end: int) -> Columns:
    """The rows of the samples first .. end - 1, counted from the first."""
    if not columns:
        return {}
    rows = slice(*np.searchsorted(columns["sample"], [first, end]))
    own = {name: values[rows] for name, values in columns.items()}
    return own | {"sample": own["sample"] - first}


def _sweeps(tables: Tables, sweeps: Columns, sample_token: NDArray[np.bytes_]) -> Columns:
    # a sweep between key frames belongs to one of its neighbours: sort by time, not by sample
    order = np.argsort(sweeps["timestamp"], kind="stable")
    sweeps = {name: values[order] for name, values in sweeps.items()}
    _check_times(tables, sweeps["timestamp"])
    key = sweeps["is_key_frame"].astype(bool)
    _check_key_frames(tables, sweeps["sample"][key], sample_token)
    return {
        "sweep_stamp_us": sweeps["timestamp"],
        "sweep_file": sweeps["filename"],
        "sweep_sample": np.where(key, sweeps["sample"], -1),
        "world_T_ego": sweeps["world_T_ego"],
        "ego_T_lidar": sweeps["ego_T_lidar"],
    }


def _check_times(tables: Tables, stamp_us: I64) -> None:
    """Refuse (S,) sorted times that nanoseconds of 64 bits can't hold, or that come twice."""
    path = tables.path("sample_data")
    wrong = stamp_us[(stamp_us < 0) | (stamp_us > LATEST_US)]
    if wrong.size:
        raise DataError(path, "timestamp", int(wrong[0]), f"microseconds, 0 to {LATEST_US}")
    repeated = np.flatnonzero(np.diff(stamp_us) <= 0)
    if repeated.size:
        raise OutOfOrderError(path, "timestamp", f"{stamp_us[repeated[0]]} twice", "each once")


def _check_key_frames(tables: Tables, keyed: I64, sample_token: NDArray[np.bytes_]) -> None:
    count = np.bincount(keyed, minlength=len(sample_token))
    wrong = np.flatnonzero(count != 1)
    if wrong.size:
        field = f"LIDAR_TOP key frames of sample {sample_token[wrong[0]].decode()}"
        raise MissingError(tables.path("sample_data"), field, int(count[wrong[0]]), "1")
    if not len(count):
        raise DataError(tables.path("sample"), "samples of a scene", 0, "at least one")


def _boxes(boxes: Columns) -> Columns:
    if not boxes:
        return _no_boxes()
    return {
        "box_sample": boxes["sample"],
        "box_instance": np.unique(boxes["instance"], return_inverse=True)[1],
        "box_category": boxes["category"],
        "box_centre_m": boxes["translation"],
        "box_size_wlh_m": boxes["size"],
        "box_rotation": boxes["rotation"],
        "box_points": boxes["num_lidar_pts"] + boxes["num_radar_pts"],
    }


def _no_boxes() -> Columns:
    whole = {name: np.zeros(0, dtype=np.int64) for name in ("sample", "instance", "points")}
    numbers = {"centre_m": 3, "size_wlh_m": 3, "rotation": 4}
    return (
        {f"box_{name}": values for name, values in whole.items()}
        | {f"box_{name}": np.zeros((0, width)) for name, width in numbers.items()}
        | {"box_category": np.zeros(0, dtype=np.bytes_)}
    )
