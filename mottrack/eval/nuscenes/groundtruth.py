"""Ground truth from tables in nuScenes format, and a cache of it.

Only the tables and key frames that are needed are read; still a full data set takes half a minute.
A cached file names the tables it was made from with their sizes and times of change, and is made
again when any of them differs. It lies in `$MOTTRACK_CACHE`, else in the user's cache folder; the
data set itself is never written to.
"""

import hashlib
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64
from mottrack.core.errors import DataError, ResultError
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Racks, Samples
from mottrack.eval.nuscenes.rules import Rules
from mottrack.formats.collector import collector_paused
from mottrack.formats.nuscenes_classes import CLASS_OF_CATEGORY, RACK_CATEGORY
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

FORMAT = "mottrack ground truth 1"
_PARTS = {"samples": Samples, "boxes": BoxTable, "racks": Racks}


def read_ground_truth(
    dataroot: Path, version: str, scene_names: Sequence[str], rules: Rules | None = None
) -> GroundTruth:
    """Read samples, true boxes and bicycle racks of the named scenes.

    Raises:
        DataError: a table or record is missing, or no scene has one of the names.
    """
    tables = _Tables(dataroot, version)
    with collector_paused():
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
        """Return token to one field, of all records or of those named."""
        path = self.path(name)
        thin = records_with("token", _encoded(tokens)) if tokens else None
        return {
            row["token"]: field(row, value, path)
            for row in self.rows(name, lambda row: not tokens or row["token"] in tokens, thin)
        }


def _samples(tables: _Tables, scene_names: Sequence[str]) -> Samples:
    """Return the samples of the scenes in order of time, scenes in the order of their table."""
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
    """Return the position of the vehicle at each sample's LiDAR key frame, (N, 2)."""
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
    """Return true boxes of the classes of the rules, in the order of the table, and racks."""
    row_of = {token: row for row, token in enumerate(samples.token.tolist())}
    category = tables.column("category", "name")
    category_of = tables.column("instance", "category_token")
    path = tables.path("instance")
    label_of = {name: rules.classes.index(c) for name, c in CLASS_OF_CATEGORY.items()}
    scene_of = samples.scene_of_sample().tolist()
    track_of: dict[tuple[int, str], int] = {}
    boxes: list[list[int]] = []
    centres: list[list[float]] = []
    rack_samples: list[int] = []
    racks: list[list[float]] = []
    in_split = records_with("sample_token", _encoded(row_of))
    for row in tables.rows(
        "sample_annotation", lambda row: row["sample_token"] in row_of, in_split
    ):
        instance = row["instance_token"]
        name = _lookup(category, _lookup(category_of, instance, path, "instance"), path, "category")
        sample = row_of[row["sample_token"]]
        if name == RACK_CATEGORY:
            rack_samples.append(sample)
            racks.append([*row["translation"], *row["size"], *row["rotation"]])
        elif name in label_of:
            track = track_of.setdefault((scene_of[sample], instance), len(track_of))
            points = row["num_lidar_pts"] + row["num_radar_pts"]
            boxes.append([sample, track, label_of[name], points])
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
    values = np.array(racks, np.float64).reshape(-1, 10)
    racks_at = np.array(rack_samples, np.int64)
    return table, Racks(racks_at, values[:, :3], values[:, 3:6], values[:, 6:])


def _lookup(table: Mapping[str, Any], token: str, path: Path, what: str) -> Any:
    if token not in table:
        raise DataError(path, f"{what} {token}", "missing", "a record for it")
    return table[token]


def cached_ground_truth(
    dataroot: Path, version: str, scene_names: Sequence[str], rules: Rules | None = None
) -> GroundTruth:
    """Return what `read_ground_truth` does, from the cache where that is up to date.

    A cache that cannot be read or written is not used.
    """
    rules = rules or Rules()
    source = fingerprint(dataroot, version)
    what = json.dumps([sorted(scene_names), list(rules.classes)])
    path = _folder() / f"{_digest(str(dataroot.resolve()), version, what)}.npz"
    stored = _read(path, source)
    if stored is not None:
        return stored
    truth = read_ground_truth(dataroot, version, scene_names, rules)
    _write(path, source, truth)
    return truth


def fingerprint(dataroot: Path, version: str) -> str:
    """Return names, sizes and times of change of the tables, as text."""
    paths = [table_path(dataroot, version, name) for name in TABLES]
    return json.dumps([(p.name, p.stat().st_size, p.stat().st_mtime_ns) for p in paths])


def _folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(os.environ.get("MOTTRACK_CACHE") or Path(base) / "mottrack")


def _digest(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:24]


def _read(path: Path, source: str) -> GroundTruth | None:
    if not path.is_file():
        return None
    try:
        arrays = read_arrays(path)
    except ResultError:
        return None
    if str(arrays.get("format")) != FORMAT or str(arrays.get("source")) != source:
        return None
    parts: dict[str, Any] = {
        prefix: kind(**{f.name: arrays[f"{prefix}.{f.name}"] for f in fields(kind)})
        for prefix, kind in _PARTS.items()
    }
    return GroundTruth(**parts)


def _write(path: Path, source: str, truth: GroundTruth) -> None:
    arrays: dict[str, NDArray[Any]] = {"format": np.array(FORMAT), "source": np.array(source)}
    for prefix in _PARTS:
        part = asdict(getattr(truth, prefix))
        arrays |= {f"{prefix}.{name}": value for name, value in part.items()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_arrays(path, arrays)
    except OSError:
        return
