"""Annotations of Argoverse 2 logs, and tracks in the layout of its detection files.

Tracks are one feather file for all logs, a row a box: `log_id`, `timestamp_ns`, `track_uuid`,
`category`, `score`, and the centre `tx_m`, `ty_m`, `tz_m` in the vehicle's frame at that time. The
official package reads pickles instead, which run code when they are opened; docs/metrics.md shows
how to convert one.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.errors import DataError
from mottrack.eval.argoverse2.boxes import Log, LogBoxes
from mottrack.eval.argoverse2.rules import CATEGORIES
from mottrack.formats.checks import (
    check_ego_places,
    check_rotations,
    check_world_places,
)
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.feather import read_feather_columns
from mottrack.formats.files import existing_folder, inside

ANNOTATIONS, POSES = "annotations.feather", "city_SE3_egovehicle.feather"
_STAMP = ColumnSpec("timestamp_ns", int)
_PLACE = specs("tx_m", "ty_m", "tz_m")
_BOX = (_STAMP, ColumnSpec("track_uuid", str), ColumnSpec("category", str), *_PLACE)
_TRACK = (*_BOX, ColumnSpec("log_id", str), ColumnSpec("score"))
_POSE = (_STAMP, *specs("qw", "qx", "qy", "qz"), *_PLACE)
_FEW = 3
"""Names that an error message lists."""


class _Poses(NamedTuple):
    """`city_T_ego` at the annotated times."""

    stamp_ns: I64
    """(T,) ascending."""
    rotation: F64
    """(T, 3, 3)"""
    place_m: F64
    """(T, 3)"""

    def city_xy_m(self, frame: I64, ego_m: F64) -> F64:
        """Return the places (N, 2) in the city frame of (N, 3) in the vehicle's at its frames."""
        city = np.einsum("nij,nj->ni", self.rotation[frame], ego_m) + self.place_m[frame]
        return np.ascontiguousarray(city[:, :2])


def read_logs(split: Path, tracks: Path) -> Iterator[Log]:
    """Yield every log of a split with its tracks; a log without any track is evaluated too.

    Args:
        split: the folder that holds one folder a log, such as `sensor/val`.
        tracks: feather file of the tracks of all logs.

    Raises:
        DataError: a file is missing or damaged, a value is out of range, a track is twice in a
            frame, or tracks are of a log or a time that is not annotated.
    """
    folders = sorted(
        path.parent for path in existing_folder(split, "split").glob(f"*/{ANNOTATIONS}")
    )
    if not folders:
        raise DataError(split, "logs", "none", f"folders LOG/{ANNOTATIONS}")
    table = _read_tracks(tracks)
    names = [folder.name for folder in folders]
    table.refuse("log_id", ~np.isin(table["log_id"], names), f"a log of {split.name}")
    for folder in folders:
        yield _read_log(folder, table.select(table["log_id"] == folder.name))


def _read_tracks(path: Path) -> Columns:
    table = _placed(read_feather_columns(path, _TRACK))
    categories = table["category"]
    table.refuse("category", categories == "", "a name")
    return table


def _read_log(folder: Path, tracks: Columns) -> Log:
    truth = _placed(read_feather_columns(inside(folder, ANNOTATIONS), _BOX))
    poses = _read_poses(folder, np.unique(truth["timestamp_ns"]))
    strange = ~np.isin(tracks["timestamp_ns"], poses.stamp_ns)
    tracks.refuse("timestamp_ns", strange, f"an annotated time of log {folder.name}")
    true = _boxes(truth, poses, np.full(len(truth), -1.0))
    return Log(folder.name, poses.place_m[:, :2], true, _boxes(tracks, poses, tracks["score"]))


def _placed(table: Columns) -> Columns:
    table = table.extended(translation=table.stacked(("tx_m", "ty_m", "tz_m")))
    check_ego_places(table, "translation")
    table.refuse("track_uuid", table["track_uuid"] == "", "a name")
    return table


def _read_poses(folder: Path, stamp_ns: I64) -> _Poses:
    table = read_feather_columns(inside(folder, POSES), _POSE)
    table = table.extended(
        rotation=table.stacked(("qw", "qx", "qy", "qz")),
        translation=table.stacked(("tx_m", "ty_m", "tz_m")),
    )
    table.refuse_repeated("timestamp_ns", table["timestamp_ns"], "each stamp once")
    check_rotations(table)
    check_world_places(table)
    order = np.argsort(table["timestamp_ns"])
    table = table.select(order)
    row = np.searchsorted(table["timestamp_ns"], stamp_ns)
    there: Mask = np.append(table["timestamp_ns"], -1)[row] == stamp_ns
    if not there.all():
        missing = stamp_ns[~there][:_FEW].tolist()
        raise DataError(table.path, "timestamp_ns", f"without {missing}", "every annotated time")
    return _Poses(stamp_ns, _rotations(table["rotation"][row]), table["translation"][row])


def _rotations(wxyz: F64) -> F64:
    """Return the rotation matrices (N, 3, 3) of quaternions (N, 4)."""
    w, x, y, z = (wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _boxes(table: Columns, poses: _Poses, score: F64) -> LogBoxes:
    frame = np.searchsorted(poses.stamp_ns, table["timestamp_ns"])
    order = np.argsort(frame, kind="stable")
    table, frame = table.select(order), frame[order]
    category = _numbered(table["category"])
    identity = np.unique(table["track_uuid"], return_inverse=True)[1].astype(np.int64)
    # one identity of two categories is two tracks, as in the package
    keys = np.column_stack([frame, identity, category])
    table.refuse_repeated("track_uuid", keys, "each track once a time")
    xy_m = poses.city_xy_m(frame, table["translation"])
    return LogBoxes(frame, identity, category, xy_m, score[order])


def _numbered(names: Texts) -> I64:
    known = {name: k for k, name in enumerate(CATEGORIES)}
    return np.array([known.get(name, -1) for name in names.tolist()], np.int64)
