"""The tables that do not follow from the scenes' frames."""

from __future__ import annotations

import struct
import zlib
from typing import Any

from mottrack.datasets.nuscenes.sweep_table import CHANNEL
from mottrack.datasets.nuscenes.taxonomy import ATTRIBUTES, CATEGORIES, VISIBILITIES
from mottrack.datasets.nuscenes.tokens import token_of

MAP_FILE = "maps/blank.png"
DATE = "2020-01-01"


def static_tables(scene_names: list[str]) -> dict[str, list[dict[str, Any]]]:
    """Return category, attribute, visibility, sensor, log and map."""
    return {
        "category": [_named("category", name) for name in CATEGORIES],
        "attribute": [_named("attribute", name) for name in ATTRIBUTES],
        "visibility": [
            {"token": token, "level": level, "description": f"visible share {level[1:]} %"}
            for token, level in VISIBILITIES.items()
        ],
        "sensor": [{"token": token_of("sensor", CHANNEL), "channel": CHANNEL, "modality": "lidar"}],
        "log": [_log(name) for name in scene_names],
        "map": [
            {
                "token": token_of("map"),
                "log_tokens": [token_of("log", name) for name in scene_names],
                "category": "semantic_prior",
                "filename": MAP_FILE,
            }
        ],
    }


def _named(kind: str, name: str) -> dict[str, Any]:
    return {"token": token_of(kind, name), "name": name, "description": name}


def _log(scene: str) -> dict[str, Any]:
    return {
        "token": token_of("log", scene),
        "logfile": scene,
        "vehicle": "synthetic",
        "date_captured": DATE,
        "location": "singapore-onenorth",
    }


def blank_map() -> bytes:
    """Return a PNG of one black pixel: the devkit insists on a map file."""
    header = struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(b"\0\0")), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(name, data) for name, data in chunks)


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
