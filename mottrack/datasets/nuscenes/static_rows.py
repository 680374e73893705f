"""Tokens, the official lists that every version repeats, and tables that follow from no frame."""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from mottrack.core.motion import MOVING_MPS
from mottrack.formats.nuscenes_classes import CLASS_OF_CATEGORY, RACK_CATEGORY
from mottrack.formats.nuscenes_records import CHANNEL

MAP_FILE = "maps/blank.png"
DATE = "2020-01-01"
CATEGORIES = (
    *CLASS_OF_CATEGORY,
    "human.pedestrian.wheelchair",
    "human.pedestrian.stroller",
    "human.pedestrian.personal_mobility",
    "animal",
    "vehicle.emergency.ambulance",
    "vehicle.emergency.police",
    "vehicle.construction",
    "movable_object.barrier",
    "movable_object.trafficcone",
    "movable_object.pushable_pullable",
    "movable_object.debris",
    RACK_CATEGORY,
)
_CATEGORY_OF = (
    {name: name for name in CATEGORIES}
    | {name: category for category, name in CLASS_OF_CATEGORY.items()}
    | {"pedestrian": "human.pedestrian.adult", "bus": "vehicle.bus.rigid"}
)
"""Label to official category; of several with the same label the commonest."""
ATTRIBUTES = (
    "vehicle.moving",
    "vehicle.stopped",
    "vehicle.parked",
    "cycle.with_rider",
    "cycle.without_rider",
    "pedestrian.sitting_lying_down",
    "pedestrian.standing",
    "pedestrian.moving",
)
VISIBILITY_SHARES = (0.4, 0.6, 0.8)
"""Visible shares at which the next level begins."""
VISIBILITIES = {"1": "v0-40", "2": "v40-60", "3": "v60-80", "4": "v80-100"}
_WALKING = ("pedestrian.moving", "pedestrian.standing")
_RIDDEN = ("cycle.with_rider", "cycle.without_rider")
_DRIVEN = ("vehicle.moving", "vehicle.parked")
_ATTRIBUTES_OF = {
    category: _WALKING if category.split(".")[:2] == ["human", "pedestrian"] else _DRIVEN
    for category in CATEGORIES
    if category.split(".")[0] in ("human", "vehicle")
} | dict.fromkeys(("vehicle.bicycle", "vehicle.motorcycle"), _RIDDEN)
"""Attribute of a category that moves, and of one that does not."""


def token_of(kind: str, *parts: object) -> str:
    """Return the token of a record, 32 hexadecimal digits.

    The same parts give the same token on every machine.
    """
    text = "/".join([kind, *map(str, parts)])
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def category_of(label: str) -> str:
    """Return the official category of a label; what is in no list is debris."""
    return _CATEGORY_OF.get(label, "movable_object.debris")


def attribute_of(category: str, speed_mps: float) -> str | None:
    """Return the attribute that tells whether it moves; None where nuScenes has none."""
    if category not in _ATTRIBUTES_OF:
        return None
    moving, still = _ATTRIBUTES_OF[category]
    return moving if speed_mps > MOVING_MPS else still


class Lists(NamedTuple):
    """What the tables of a dialect list.

    categories: of objects. levels: token of a visibility to its name and its description.
    channels: the LiDARs. further: fields by table that nuScenes does not have.
    date: the field of a log that says when it was recorded.
    empty: tables that readers of the dialect insist on and nobody here fills.
    """

    categories: Sequence[str]
    levels: Mapping[str, tuple[str, str]]
    channels: Sequence[str]
    further: Mapping[str, dict[str, Any]]
    date: str = "date_captured"
    empty: tuple[str, ...] = ()


NUSCENES_LISTS = Lists(
    CATEGORIES,
    {token: (level, f"visible share {level[1:]} %") for token, level in VISIBILITIES.items()},
    (CHANNEL,),
    {},
)


def static_tables(
    scene_names: list[str], lists: Lists = NUSCENES_LISTS
) -> dict[str, list[dict[str, Any]]]:
    """Return category, attribute, visibility, sensor, log and map."""
    more = lists.further
    empty: dict[str, list[dict[str, Any]]] = {name: [] for name in lists.empty}
    return empty | {
        "category": [_named("category", n) | more.get("category", {}) for n in lists.categories],
        "attribute": [_named("attribute", name) for name in ATTRIBUTES],
        "visibility": [
            {"token": token, "level": level, "description": description}
            for token, (level, description) in lists.levels.items()
        ],
        "sensor": [
            {"token": token_of("sensor", channel), "channel": channel, "modality": "lidar"}
            for channel in lists.channels
        ],
        "log": [_log(name, lists.date) for name in scene_names],
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


def _log(scene: str, date: str) -> dict[str, Any]:
    return {
        "token": token_of("log", scene),
        "logfile": scene,
        "vehicle": "synthetic",
        date: DATE,
        "location": "singapore-onenorth",
    }


def blank_map() -> bytes:
    """Return a PNG of one black pixel: the devkit insists on a map file."""
    header = struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(b"\0\0")), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(name, data) for name, data in chunks)


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
