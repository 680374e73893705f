"""Random tracks in nuScenes format, as dense as the validation split: 44 boxes a frame."""

import json
import struct
import zlib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.formats.nuscenes_splits import split_scenes

FRAMES = 40
TRACKS = 60
"""True tracks a scene; each is there for 44 / 60 of the frames on average."""
CATEGORIES = {
    "vehicle.car": ("car", 0.5, (1.9, 4.6, 1.7)),
    "human.pedestrian.adult": ("pedestrian", 0.24, (0.7, 0.7, 1.8)),
    "vehicle.truck": ("truck", 0.08, (2.5, 7.0, 3.0)),
    "vehicle.bus.rigid": ("bus", 0.03, (2.9, 11.0, 3.5)),
    "vehicle.trailer": ("trailer", 0.05, (2.9, 12.0, 3.9)),
    "vehicle.motorcycle": ("motorcycle", 0.05, (0.8, 2.1, 1.5)),
    "vehicle.bicycle": ("bicycle", 0.05, (0.6, 1.7, 1.3)),
}
Row = dict[str, Any]


def write_dataset(root: Path, scenes: int, seed: int) -> int:
    """Writes tables, a submission and the list of scenes; returns the number of true boxes."""
    rng = np.random.default_rng(seed)
    names = split_scenes("val")[:scenes]
    tables: dict[str, list[Row]] = _fixed_tables()
    results: dict[str, list[Row]] = {}
    for number, name in enumerate(names):
        _add_scene(rng, tables, results, (number, name))
    (root / "v1.0-trainval").mkdir(parents=True)
    (root / "maps").mkdir()
    (root / "maps/m.png").write_bytes(_tiny_png())
    for table, rows in tables.items():
        (root / "v1.0-trainval" / f"{table}.json").write_text(json.dumps(rows))
    meta = {f"use_{x}": x == "lidar" for x in ("camera", "lidar", "radar", "map", "external")}
    (root / "submission.json").write_text(json.dumps({"meta": meta, "results": results}))
    (root / "scenes.txt").write_text("\n".join(names))
    return len(tables["sample_annotation"])


def _fixed_tables() -> dict[str, list[Row]]:
    names = ("scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation")
    tables: dict[str, list[Row]] = {name: [] for name in names}
    tables["attribute"] = []
    tables["visibility"] = [{"token": "4", "level": "v80-100", "description": ""}]
    tables["log"] = [
        {
            "token": "log",
            "logfile": "l",
            "vehicle": "v",
            "date_captured": "2018-01-01",
            "location": "boston-seaport",
        }
    ]
    tables["map"] = [
        {
            "token": "map",
            "log_tokens": ["log"],
            "category": "semantic_prior",
            "filename": "maps/m.png",
        }
    ]
    tables["sensor"] = [{"token": "lidar", "channel": "LIDAR_TOP", "modality": "lidar"}]
    tables["calibrated_sensor"] = [
        {
            "token": "mount",
            "sensor_token": "lidar",
            "translation": [0.9, 0.0, 1.8],
            "rotation": [1.0, 0.0, 0.0, 0.0],
            "camera_intrinsic": [],
        }
    ]
    tables["category"] = [
        {"token": name, "name": name, "description": "", "index": i}
        for i, name in enumerate(CATEGORIES)
    ]
    return tables


def _add_scene(
    rng: np.random.Generator,
    tables: dict[str, list[Row]],
    results: dict[str, list[Row]],
    scene: tuple[int, str],
) -> None:
    number, name = scene
    origin = rng.uniform(300, 2500, 2)
    ego = origin + np.arange(FRAMES)[:, None] * rng.normal(0, 2, 2)
    tokens = [f"{number:04d}sample{frame:022d}" for frame in range(FRAMES)]
    stamps = 1_530_000_000_000_000 + number * 10**9 + np.arange(FRAMES) * 500_000
    stamps = (stamps + rng.integers(-3000, 3000, FRAMES)).tolist()
    tables["scene"].append(
        {
            "token": name,
            "log_token": "log",
            "nbr_samples": FRAMES,
            "first_sample_token": tokens[0],
            "last_sample_token": tokens[-1],
            "name": name,
            "description": "",
        }
    )
    linked = ["", *tokens, ""]
    for frame, token in enumerate(tokens):
        _add_sample(tables, (name, token, stamps[frame]), ego[frame])
        tables["sample"][-1] |= {"prev": linked[frame], "next": linked[frame + 2]}
        results[token] = []
    for track in range(TRACKS):
        centre, frames, kind = _true_track(rng, ego)
        _annotate(tables, (f"{number:04d}inst{track:024d}", kind), frames, (tokens, centre))
        _predict(rng, results, (number * 1000 + track, kind), (tokens, frames, centre))


def _add_sample(tables: dict[str, list[Row]], sample: tuple[str, str, int], ego: Any) -> None:
    scene, token, stamp = sample
    tables["sample"].append({"token": token, "timestamp": stamp, "scene_token": scene})
    pose = {"token": token, "timestamp": stamp, "rotation": [1.0, 0.0, 0.0, 0.0]}
    tables["ego_pose"].append(pose | {"translation": [*ego.tolist(), 0.0]})
    tables["sample_data"].append(
        {
            "token": token,
            "sample_token": token,
            "ego_pose_token": token,
            "calibrated_sensor_token": "mount",
            "timestamp": stamp,
            "fileformat": "pcd",
            "is_key_frame": True,
            "height": 0,
            "width": 0,
            "filename": "x",
            "prev": "",
            "next": "",
        }
    )


def _true_track(
    rng: np.random.Generator, ego: NDArray[np.float64]
) -> tuple[NDArray[np.float64], range, str]:
    """Positions in every frame, the frames in which it is there, and the category."""
    kinds = list(CATEGORIES)
    kind = kinds[rng.choice(len(kinds), p=[CATEGORIES[k][1] for k in kinds])]
    length = int(np.clip(rng.normal(29.4, 8), 2, FRAMES))
    first = int(rng.integers(0, FRAMES - length + 1))
    start = ego[first + length // 2] + rng.uniform(-32, 32, 2)
    step = rng.normal(0, 0.3, 2) if rng.random() < 0.5 else np.zeros(2)
    centre = start + (np.arange(FRAMES) - first)[:, None] * step
    return np.column_stack([centre, np.zeros(FRAMES)]), range(first, first + length), kind


def _annotate(
    tables: dict[str, list[Row]],
    instance: tuple[str, str],
    frames: range,
    where: tuple[list[str], NDArray[np.float64]],
) -> None:
    token, kind = instance
    tokens, centre = where
    names = [f"{token}{frame}" for frame in frames]
    tables["instance"].append(
        {
            "token": token,
            "category_token": kind,
            "nbr_annotations": len(names),
            "first_annotation_token": names[0],
            "last_annotation_token": names[-1],
        }
    )
    around = list(pairwise(["", *names, ""]))
    for k, frame in enumerate(frames):
        tables["sample_annotation"].append(
            {
                "token": names[k],
                "sample_token": tokens[frame],
                "instance_token": token,
                "visibility_token": "4",
                "attribute_tokens": [],
                "translation": centre[frame].tolist(),
                "size": list(CATEGORIES[kind][2]),
                "rotation": [1.0, 0.0, 0.0, 0.0],
                "prev": around[k][0],
                "next": around[k + 1][1],
                "num_lidar_pts": 5,
                "num_radar_pts": 0,
            }
        )


def _predict(
    rng: np.random.Generator,
    results: dict[str, list[Row]],
    track: tuple[int, str],
    where: tuple[list[str], range, NDArray[np.float64]],
) -> None:
    """The track seen nine times out of ten, its identity changing, and false ones beside it."""
    number, kind = track
    tokens, frames, centre = where
    identity, score = number * 10, float(rng.beta(4, 2))
    ghost, ghost_score = number * 10 + 9, float(rng.beta(2, 4))
    for frame in frames:
        identity += int(rng.random() < 0.02)
        if rng.random() < 0.9:
            near = centre[frame] + rng.normal(0, 0.35, 3)
            noisy = float(np.clip(score + rng.normal(0, 0.05), 0, 1))
            results[tokens[frame]].append(_box((tokens[frame], identity, kind), near, noisy))
        if rng.random() < 0.1:
            near = centre[frame] + rng.normal(0, 3, 3)
            box = _box((tokens[frame], ghost, kind), near, ghost_score)
            results[tokens[frame]].append(box)


def _box(what: tuple[str, int, str], centre: NDArray[np.float64], score: float) -> Row:
    sample, identity, kind = what
    return {
        "sample_token": sample,
        "translation": centre.tolist(),
        "size": list(CATEGORIES[kind][2]),
        "rotation": [1.0, 0.0, 0.0, 0.0],
        "velocity": [0.0, 0.0],
        "tracking_id": str(identity),
        "tracking_name": CATEGORIES[kind][0],
        "tracking_score": score,
    }


def _tiny_png() -> bytes:
    """A grey pixel: the devkit wants every map to be there."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        check = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)

    head = struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0)
    body = zlib.compress(b"\0\0")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")
