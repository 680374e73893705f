"""Ground truth from tables in nuScenes format; only the tables and key frames that are needed."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.errors import DataError
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Racks, Samples
from mottrack.eval.nuscenes.rules import CLASS_OF_CATEGORY, RACK_CATEGORY, Rules
from mottrack.formats.nuscenes_tables import (
    Row,
    Thinning,
    field,
    records_with,
    stream_table,
    table_path,
)

LIDAR = "LIDAR_TOP"
TABLES = (
    "scene", "sample", "sample_data", "ego_pose", "sensor", "calibrated_sensor", "category",
    "instance", "sample_annotation",
)  # fmt: skip


def read_ground_truth(
    dataroot: Path, version: str, scene_names: Sequence[str], rules: Rules | None = None
) -> GroundTruth:
    """Samples, true boxes and bicycle racks of the named scenes.

    Raises DataError for a missing table or record, and for a name that no scene has.
    """
    tables = _Tables(dataroot, version)
    samples = _samples(tables, scene_names)
    boxes, racks = _annotations(tables, samples, rules or Rules())
    return GroundTruth(samples, boxes, racks)


def _all_rows(_row: Row) -> bool:
    return True


def _encoded(tokens: Iterable[str]) -> frozenset[bytes]:
    return frozenset(token.encode() for token in tokens)


@dataclass(frozen=True, slots=True)
class _Tables:
    dataroot: Path
    version: str

    def path(self, name: str) -> Path:
        return table_path(self.dataroot, self.version, name)

    def rows(
        self, name: str, keep: Callable[[Row], bool] = _all_rows, thin: Thinning | None = None
    ) -> Iterator[Row]:
        path = self.path(name)
        for row in stream_table(path, thin=thin):
            try:
                if keep(row):
                    yield row
            except KeyError as error:
                raise DataError(
                    path, f"record {row.get('token')}", f"without {error}", "it"
                ) from None

    def column(self, name: str, value: str, tokens: Collection[str] = ()) -> dict[str, Any]:
        """Token to one field, of all records or of those named."""
        path = self.path(name)
        thin = records_with("token", _encoded(tokens)) if tokens else None
        return {
            row["token"]: field(row, value, path)
            for row in self.rows(name, lambda row: not tokens or row["token"] in tokens, thin)
        }


def _samples(tables: _Tables, scene_names: Sequence[str]) -> Samples:
    """Samples of the scenes in order of time, scenes in the order of their table."""
    wanted = set(scene_names)
    scenes = list(tables.rows("scene", lambda row: row["name"] in wanted))
    missing = sorted(wanted - {row["name"] for row in scenes})
    if missing:
        few = ", ".join(missing[:5]) + (f" and {len(missing) - 5} more" if len(missing) > 5 else "")
        raise DataError(tables.path("scene"), "scenes", f"without {few}", "all scenes of the split")
    number = {row["token"]: i for i, row in enumerate(scenes)}
    rows = list(tables.rows("sample", lambda row: row["scene_token"] in number))
    scene = np.array([number[row["scene_token"]] for row in rows], np.int64)
    stamp = np.array([row["timestamp"] for row in rows], np.int64)
    order = np.lexsort((stamp, scene))
    token = np.array([row["token"] for row in rows], np.str_)[order]
    return Samples(
        scene_name=np.array([row["name"] for row in scenes], np.str_),
        first=np.searchsorted(scene[order], np.arange(len(scenes) + 1)).astype(np.int64),
        token=token,
        stamp_us=stamp[order],
        ego_xy_m=_ego_positions(tables, token.tolist()),
    )


def _ego_positions(tables: _Tables, samples: Sequence[str]) -> F64:
    """(N, 2) position of the vehicle when each sample's LiDAR key frame was taken."""
    wanted = set(samples)
    lidars = {row["token"] for row in tables.rows("sensor", lambda row: row["channel"] == LIDAR)}
    mounts = {
        row["token"]
        for row in tables.rows("calibrated_sensor", lambda row: row["sensor_token"] in lidars)
    }
    pose_of = {
        row["sample_token"]: row["ego_pose_token"]
        for row in tables.rows(
            "sample_data",
            lambda row: (
                row["is_key_frame"]
                and row["calibrated_sensor_token"] in mounts
                and row["sample_token"] in wanted
            ),
            records_with("sample_token", _encoded(wanted)),
        )
    }
    path = tables.path("sample_data")
    where = tables.column("ego_pose", "translation", set(pose_of.values()))
    poses = [_lookup(pose_of, sample, path, f"{LIDAR} key frame of sample") for sample in samples]
    path = tables.path("ego_pose")
    return np.array([_lookup(where, pose, path, "pose")[:2] for pose in poses]).reshape(-1, 2)


def _annotations(tables: _Tables, samples: Samples, rules: Rules) -> tuple[BoxTable, Racks]:
    """True boxes of the classes of the rules, in the order of the table, and racks."""
    row_of = {token: row for row, token in enumerate(samples.token.tolist())}
    category = tables.column("category", "name")
    category_of = tables.column("instance", "category_token")
    path = tables.path("instance")
    label_of = {name: rules.classes.index(c) for name, c in CLASS_OF_CATEGORY.items()}
    scene_of = samples.scene_of_sample().tolist()
    track_of: dict[tuple[int, str], int] = {}
    boxes: list[tuple[int, int, int, int]] = []
    centres: list[list[float]] = []
    racks: list[tuple[int, list[float], list[float], list[float]]] = []
    judged = records_with("sample_token", _encoded(row_of))
    for row in tables.rows("sample_annotation", lambda row: row["sample_token"] in row_of, judged):
        instance = row["instance_token"]
        name = _lookup(category, _lookup(category_of, instance, path, "instance"), path, "category")
        sample = row_of[row["sample_token"]]
        if name == RACK_CATEGORY:
            racks.append((sample, row["translation"], row["size"], row["rotation"]))
        elif name in label_of:
            track = track_of.setdefault((scene_of[sample], instance), len(track_of))
            points = row["num_lidar_pts"] + row["num_radar_pts"]
            boxes.append((sample, track, label_of[name], points))
            centres.append(row["translation"])
    columns = np.array(boxes, np.int64).reshape(-1, 4)
    table = BoxTable(
        sample=columns[:, 0].copy(),
        track=columns[:, 1].copy(),
        label=columns[:, 2].astype(np.int8),
        centre_m=np.array(centres, np.float64).reshape(-1, 3),
        score=np.full(len(boxes), -1.0),
        num_points=columns[:, 3].copy(),
    )
    return table, _rack_table(racks)


def _rack_table(racks: list[tuple[int, list[float], list[float], list[float]]]) -> Racks:
    sample = np.array([rack[0] for rack in racks], np.int64)
    parts = [np.array([rack[k] for rack in racks], np.float64) for k in (1, 2, 3)]
    centre, size, rotation = parts[0].reshape(-1, 3), parts[1].reshape(-1, 3), parts[2]
    return Racks(sample, centre, size, rotation.reshape(-1, 4))


def _lookup(table: Mapping[str, Any], token: str, path: Path, what: str) -> Any:
    if token not in table:
        raise DataError(path, f"{what} {token}", "missing", "a record for it")
    return table[token]
