"""Write any scenes as a nuScenes data set: the thirteen tables, sweeps, a detection file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import orjson

from mottrack.core import InputError, Scene
from mottrack.core.errors import unknown_name
from mottrack.core.storage import write_bytes, write_text
from mottrack.datasets.nuscenes.rehearsal import RehearsalScene
from mottrack.datasets.nuscenes.scene_rows import SceneRows
from mottrack.datasets.nuscenes.static_rows import MAP_FILE, blank_map, static_tables
from mottrack.datasets.nuscenes.style import NUSCENES_STYLE, T4_STYLE, TRUCKSCENES_STYLE, Style
from mottrack.datasets.nuscenes.submission import LIDAR_ONLY
from mottrack.datasets.nuscenes.t4 import TABLES as T4_TABLES
from mottrack.datasets.nuscenes.truckscenes_splits import truckscenes_splits
from mottrack.formats.nuscenes_splits import split_scenes
from mottrack.formats.table_stream import Row

VERSION = "v1.0-trainval"
SPLITS_OF = {VERSION: ("val", "train"), "v1.0-mini": ("mini_val", "mini_train")}
DETECTIONS = "detections/synthetic.json"


def write_rehearsal(scenes: Iterable[Scene], root: Path, version: str = VERSION) -> tuple[str, ...]:
    """Write scenes with racks, returns of the own body and all else that the real data set has."""
    return write_nuscenes(map(RehearsalScene, scenes), root, version)


def write_nuscenes(scenes: Iterable[Scene], root: Path, version: str = VERSION) -> tuple[str, ...]:
    """Write the scenes under official names, those of the val split first; return the names.

    The devkit evaluates only scenes that have an official name. Sweeps become LIDAR_TOP in the
    sensor's own frame (x right, y forward); stamps are rounded to the microsecond of the format.

    Raises:
        ConfigError: the version has another name than those of `SPLITS_OF`.
        InputError: more scenes than nuScenes has names.
    """
    if version not in SPLITS_OF:
        raise unknown_name("version", version, SPLITS_OF)
    official = tuple(name for split in SPLITS_OF[version] for name in split_scenes(split))
    return _write(scenes, root / version, official, NUSCENES_STYLE)


def write_truckscenes(
    scenes: Iterable[Scene], root: Path, version: str = VERSION
) -> tuple[str, ...]:
    """Write the scenes as MAN TruckScenes under official names; return the names.

    The points are shared out among six LiDARs, each of them 2 ms behind the one before.

    Raises:
        ConfigError: the version has another name than those of `SPLITS_OF`.
        InputError: more scenes than TruckScenes has names.
    """
    if version not in SPLITS_OF:
        raise unknown_name("version", version, SPLITS_OF)
    splits = truckscenes_splits()
    official = tuple(name for split in SPLITS_OF[version] for name in splits[split])
    return _write(scenes, root / version, official, TRUCKSCENES_STYLE)


def write_t4(scenes: Iterable[Scene], root: Path) -> tuple[str, ...]:
    """Write each scene as a data set of Autoware's T4 format, and one file of detections.

    The names are those of the scenes. Points are in the frame of the vehicle, as T4 has them.
    """
    results: dict[str, list[Row]] = {}
    names = []
    for scene in scenes:
        folder = root / scene.name
        rows = SceneRows(scene.name, folder, T4_STYLE)
        rows.add_all(scene)
        # tables hold what annotators named, beyond the format's own list
        further = sorted(rows.categories.difference(T4_STYLE.lists.categories))
        lists = T4_STYLE.lists._replace(categories=(*T4_STYLE.lists.categories, *further))
        _write_tables(folder / T4_TABLES, static_tables([scene.name], lists) | rows.tables)
        write_text(folder / "status.json", "{}\n")
        write_bytes(folder / MAP_FILE, blank_map())
        results |= rows.detections
        names.append(scene.name)
    _write_detections(root, results)
    return tuple(names)


def _write(
    scenes: Iterable[Scene], folder: Path, official: Sequence[str], style: Style
) -> tuple[str, ...]:
    """Write the tables into a folder, files and detections beside it; return the names."""
    root = folder.parent
    tables: dict[str, list[Row]] = {}
    results: dict[str, list[Row]] = {}
    names = []
    for number, scene in enumerate(scenes):
        if number >= len(official):
            raise InputError("number of scenes", number + 1, f"at most {len(official)}")
        names.append(official[number])
        rows = SceneRows(official[number], root, style)
        rows.add_all(scene)
        results |= rows.detections
        for table, records in rows.tables.items():
            tables.setdefault(table, []).extend(records)
    _write_tables(folder, static_tables(names, style.lists) | tables)
    write_bytes(root / MAP_FILE, blank_map())
    _write_detections(root, results)
    return tuple(names)


def _write_tables(folder: Path, tables: Mapping[str, list[Row]]) -> None:
    for table, records in tables.items():
        write_bytes(folder / f"{table}.json", table_bytes(records))


def _write_detections(root: Path, results: Mapping[str, list[Row]]) -> None:
    # not orjson, which writes null for NaN; detectors write NaN
    write_text(root / DETECTIONS, json.dumps({"meta": LIDAR_ONLY, "results": results}))


def table_bytes(records: list[Row]) -> bytes:
    """Return a table as JSON, one record a line."""
    return b"[\n" + b",\n".join(orjson.dumps(record) for record in records) + b"\n]\n"
