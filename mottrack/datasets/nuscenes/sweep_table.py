"""The LIDAR_TOP records of sample_data, with ego poses and mounting."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64
from mottrack.datasets.faults import MissingError
from mottrack.datasets.nuscenes.columns import Kind
from mottrack.datasets.nuscenes.tables import (
    ROTATION,
    TOKEN,
    TRANSLATION,
    Columns,
    Rows,
    Tables,
    looked_up,
    text_of,
)

CHANNEL = "LIDAR_TOP"
_KINDS = (
    Kind("sample_token", text=True),
    Kind("ego_pose_token", text=True),
    Kind("calibrated_sensor_token", text=True),
    Kind("timestamp", integer=True),
    Kind("is_key_frame", integer=True),
    Kind("filename", text=True),
)


def sweep_columns(tables: Tables, sample_index: dict[str, int]) -> Columns:
    """Return sample (its index), timestamp, is_key_frame, filename, world_T_ego and ego_T_lidar.

    Sorted by sample; timestamps in microseconds; poses are (S, 7), quaternion then translation.

    Raises:
        DataError: a damaged table, a record that points to none, or a pose that is none.
    """
    mounts = _lidar_mounts(tables)
    rows = Rows({"calibrated_sensor_token": mounts, "sample_token": sample_index})
    columns = tables.columns("sample_data", _KINDS, rows)
    columns["sample"] = looked_up(columns.pop("sample_token"), sample_index)
    mount = [mounts[token] for token in text_of(columns.pop("calibrated_sensor_token"))]
    columns["ego_T_lidar"] = np.array(mount).reshape(-1, 7)
    columns["world_T_ego"] = _ego_poses(tables, columns.pop("ego_pose_token"))
    order = np.argsort(columns["sample"], kind="stable")
    return {name: values[order] for name, values in columns.items()}


def _lidar_mounts(tables: Tables) -> dict[str, F64]:
    """`ego_T_lidar` (7,) of each calibrated LIDAR_TOP."""
    sensors = tables.columns("sensor", (TOKEN, Kind("channel", text=True)))
    lidars = set(text_of(sensors["token"][sensors["channel"] == CHANNEL.encode()]))
    if not lidars:
        raise MissingError(tables.path("sensor"), "channel", "missing", CHANNEL)
    kinds = (TOKEN, ROTATION, TRANSLATION)
    mounts = tables.columns("calibrated_sensor", kinds, Rows({"sensor_token": lidars}))
    tables.check_poses("calibrated_sensor", mounts)
    poses = np.hstack([mounts["rotation"], mounts["translation"]])
    return dict(zip(text_of(mounts["token"]), poses, strict=True))


def _ego_poses(tables: Tables, tokens: NDArray[np.bytes_]) -> F64:
    # several sweeps may share a pose, so look up by token both ways
    wanted = {token: place for place, token in enumerate(dict.fromkeys(text_of(tokens)))}
    found = tables.columns("ego_pose", (TOKEN, ROTATION, TRANSLATION), Rows({"token": wanted}))
    tables.check_poses("ego_pose", found)
    poses = np.full((len(wanted), 7), np.nan)
    poses[looked_up(found["token"], wanted)] = np.hstack([found["rotation"], found["translation"]])
    for token, place in wanted.items():
        if np.isnan(poses[place, 0]):
            raise MissingError(tables.path("ego_pose"), "record", "missing", f"ego pose {token}")
    return poses[looked_up(tokens, wanted)]
