"""Write any scenes as a nuScenes data set: the thirteen tables, sweeps, a detection file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import orjson

from mottrack.core import InputError, Scene
from mottrack.core.storage import write_bytes
from mottrack.datasets.nuscenes.scene_rows import SceneRows
from mottrack.datasets.nuscenes.static_rows import MAP_FILE, blank_map, static_tables
from mottrack.datasets.nuscenes.submission import LIDAR_ONLY
from mottrack.formats.nuscenes_splits import split_scenes
from mottrack.formats.table_stream import Row

VERSION = "v1.0-trainval"
DETECTIONS = "detections/synthetic.json"


def write_nuscenes(scenes: Iterable[Scene], root: Path) -> tuple[str, ...]:
    """Write the scenes under official names, those of the val split first; return the names.

    The devkit evaluates only scenes that have an official name. Sweeps become LIDAR_TOP in the
    sensor's own frame (x right, y forward); stamps are rounded to the microsecond of the format.

    Raises:
        InputError: more scenes than nuScenes has names.
    """
    official = (*split_scenes("val"), *split_scenes("train"))
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
        write_bytes(root / VERSION / f"{table}.json", table_bytes(records))
    write_bytes(root / MAP_FILE, blank_map())
    write_bytes(root / DETECTIONS, orjson.dumps({"meta": LIDAR_ONLY, "results": results}))
    return tuple(names)


def table_bytes(records: list[Row]) -> bytes:
    """Return a table as JSON, one record a line."""
    return b"[\n" + b",\n".join(orjson.dumps(record) for record in records) + b"\n]\n"
