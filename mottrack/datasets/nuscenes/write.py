"""Write any scenes as a nuScenes data set: the thirteen tables, sweeps, a detection file."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import orjson

from mottrack.core import InputError, Scene
from mottrack.core.errors import unknown_name
from mottrack.core.storage import write_bytes, write_text
from mottrack.datasets.nuscenes.rehearsal import RehearsalScene
from mottrack.datasets.nuscenes.scene_rows import SceneRows
from mottrack.datasets.nuscenes.static_rows import MAP_FILE, blank_map, static_tables
from mottrack.datasets.nuscenes.submission import LIDAR_ONLY
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
    tables: dict[str, list[Row]] = {}
    results: dict[str, list[Row]] = {}
    names = []
    for number, scene in enumerate(scenes):
        if number >= len(official):
            raise InputError("number of scenes", number + 1, f"at most {len(official)}")
        names.append(official[number])
        rows = SceneRows(official[number], root)
        rows.add_all(scene)
        results |= rows.detections
        for table, records in rows.tables.items():
            tables.setdefault(table, []).extend(records)
    for table, records in (static_tables(names) | tables).items():
        write_bytes(root / version / f"{table}.json", table_bytes(records))
    write_bytes(root / MAP_FILE, blank_map())
    # not orjson, which writes null for NaN; detectors write NaN
    write_text(root / DETECTIONS, json.dumps({"meta": LIDAR_ONLY, "results": results}))
    return tuple(names)


def table_bytes(records: list[Row]) -> bytes:
    """Return a table as JSON, one record a line."""
    return b"[\n" + b",\n".join(orjson.dumps(record) for record in records) + b"\n]\n"
