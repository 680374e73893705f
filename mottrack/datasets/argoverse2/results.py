"""Tracks in Argoverse 2's formats: the table of cuboids, and what av2's evaluator takes.

The table `tracks.feather` has the columns of a detection submission and `track_uuid`, cuboids in
the ego frame, and the velocity in the city frame as `vx`, `vy` where it is known. The evaluator of
the package av2 (`python -m av2.evaluation.tracking.eval`) reads two pickles of frames in the city
frame, `predictions.pkl` and `ground_truth.pkl`; they are written, never read.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather

from mottrack.core import Pose, SceneResult
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.pose import wrap_angle
from mottrack.core.storage import write_bytes
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.datasets.argoverse2.log_files import (
    CUBOID,
    ROTATION,
    SIZE,
    TRANSLATION,
    checked_cuboids,
    labels_of,
)
from mottrack.datasets.argoverse2.write import categories
from mottrack.datasets.imported import ImportedTracks
from mottrack.datasets.scene_boxes import to_world, unknown_velocities
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.feather import feather_names, read_feather_columns
from mottrack.formats.rigid import quaternion_yaws, yaw_quaternions

TRACKS, PREDICTIONS, GROUND_TRUTH = "tracks.feather", "predictions.pkl", "ground_truth.pkl"
VELOCITY = ("vx", "vy")
CATEGORIES = (
    "ARTICULATED_BUS", "BICYCLE", "BICYCLIST", "BOLLARD", "BOX_TRUCK", "BUS",
    "CONSTRUCTION_BARREL", "CONSTRUCTION_CONE", "DOG", "LARGE_VEHICLE", "MESSAGE_BOARD_TRAILER",
    "MOBILE_PEDESTRIAN_CROSSING_SIGN", "MOTORCYCLE", "MOTORCYCLIST", "PEDESTRIAN",
    "REGULAR_VEHICLE", "SCHOOL_BUS", "SIGN", "STOP_SIGN", "STROLLER", "TRUCK", "TRUCK_CAB",
    "VEHICULAR_TRAILER", "WHEELCHAIR", "WHEELED_DEVICE", "WHEELED_RIDER",
)  # fmt: skip
"""The categories of the benchmark: av2's evaluator ends at any other one."""
PROTOCOL = 4
"""Of the pickles: the evaluator runs on Pythons from 3.8 on."""


def write_tracks(folder: Path, results: Sequence[SceneResult]) -> int:
    """Write the table and the evaluator's files; return the number of boxes."""
    table = pa.concat_tables([_table(result) for result in results])
    sink = pa.BufferOutputStream()
    pyarrow.feather.write_feather(table, sink)
    write_bytes(folder / TRACKS, sink.getvalue().to_pybytes())
    for name, side in ((PREDICTIONS, "tracks"), (GROUND_TRUTH, "truth")):
        frames = {result.name: _frames(result, getattr(result, side)) for result in results}
        write_bytes(folder / name, pickle.dumps(frames, protocol=PROTOCOL))
    return int(table.num_rows)


def _table(result: SceneResult) -> pa.Table:
    tracks, frames = result.tracks, result.frames
    world_T_ego = frames.world_T_ego[tracks.frame]
    centre_m = np.einsum(
        "nji,nj->ni", world_T_ego[:, :3, :3], tracks.centre_m - world_T_ego[:, :3, 3]
    )
    ego_yaw = np.array([Pose.from_matrix(m).yaw_rad for m in frames.world_T_ego])
    rotation = yaw_quaternions(wrap_angle(tracks.yaw_rad - ego_yaw[tracks.frame]))
    values = np.hstack([tracks.size_m, rotation, centre_m])
    columns: dict[str, Any] = {
        "timestamp_ns": frames.stamp_ns[tracks.frame],
        "log_id": pa.array([result.name] * len(tracks), pa.string()),
        "track_uuid": pa.array([str(i) for i in tracks.id], pa.string()),
        "category": categories(tracks.label),
        **{name: values[:, i] for i, name in enumerate((*SIZE, *ROTATION, *TRANSLATION))},
        "score": tracks.score,
        **{name: tracks.velocity_mps[:, i] for i, name in enumerate(VELOCITY)},
    }
    return pa.table(columns)


def _frames(result: SceneResult, boxes: TrackTable | TruthTable) -> list[dict[str, Any]]:
    """Return the annotated frames as av2's evaluator has them; city frame."""
    frames = result.frames
    names = np.array(categories(boxes.label).to_pylist(), dtype=np.str_)
    known = np.isin(names, CATEGORIES)
    velocity = np.nan_to_num(boxes.velocity_mps)  # which the evaluator does not look at
    found = []
    for index in np.flatnonzero(frames.annotated).tolist():
        rows = np.flatnonzero((boxes.frame == index) & known)
        frame = {
            "seq_id": result.name,
            "timestamp_ns": int(frames.stamp_ns[index]),
            # a list: of arrays av2 picks the rows
            "ego_translation_m": frames.world_T_ego[index, :3, 3].tolist(),
            "track_id": boxes.id[rows],
            "translation_m": boxes.centre_m[rows],
            "size": boxes.size_m[rows],
            "yaw": boxes.yaw_rad[rows],
            "velocity_m_per_s": np.column_stack([velocity[rows], np.zeros(len(rows))]),
            "name": names[rows],
            "label": np.zeros(len(rows), np.int64),  # the evaluator goes by the name
        }
        if isinstance(boxes, TrackTable):
            frame["score"] = boxes.score[rows]
        found.append(frame)
    return found


def read_table(path: Path) -> Columns:
    """Read the tracks of all logs.

    Raises:
        DataError: damaged file, or a value out of range.
    """
    names = feather_names(path)
    speeds = tuple(ColumnSpec(name, blank=np.nan) for name in VELOCITY if name in names)
    further = (ColumnSpec("score"), ColumnSpec("log_id", str), ColumnSpec("track_uuid", str))
    table = checked_cuboids(read_feather_columns(path, (*CUBOID, *further, *speeds)))
    table.refuse("track_uuid", table["track_uuid"] == "", "a name")
    return table


def tracks_of_log(
    table: Columns, frames: SceneFrames, class_map: Mapping[str, str]
) -> ImportedTracks | None:
    """Return the tracks of one log; None where the table has none of it.

    Args:
        table: of all logs.
        frames: of the log.
        class_map: category to label.

    Raises:
        DataError: a time that is no frame's, or a track twice at one time.
    """
    table = table.select(np.flatnonzero(table["log_id"] == frames.scene))
    if not len(table):
        return None
    place = frames.places_of_keys(table["timestamp_ns"].astype(np.str_), table.path)
    keys = np.column_stack([place, _numbered(table["track_uuid"])])
    table.refuse_repeated("track_uuid", keys, "each track once a time")
    yaw_rad = quaternion_yaws(table["rotation"])
    centre_m, world_yaw = to_world(table["translation"], yaw_rad, place, frames.world_T_ego)
    known = all(name in table.arrays for name in VELOCITY)
    return ImportedTracks(
        frame=place,
        label=labels_of(table["category"], class_map),
        score=table["score"],
        centre_m=centre_m,
        size_m=table["size"],
        yaw_rad=world_yaw,
        velocity_mps=_velocity(table.stacked(VELOCITY))
        if known
        else unknown_velocities(len(table)),
        track=table["track_uuid"],
        observed=np.ones(len(table), np.bool_),
    )


def _velocity(velocity_mps: F64) -> F64:
    """Return velocities, of which both numbers are known or none."""
    known = np.asarray(np.isfinite(velocity_mps).all(axis=1))
    return np.where(known[:, None], velocity_mps, np.nan)


def _numbered(names: Texts) -> I64:
    return np.unique(names, return_inverse=True)[1].astype(np.int64)
