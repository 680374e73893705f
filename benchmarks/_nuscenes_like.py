"""Random tracks in nuScenes format, as dense as the validation split: 44 boxes a frame."""

import json
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.arrays import F64
from mottrack.datasets.nuscenes.static_rows import MAP_FILE, blank_map, static_tables, token_of
from mottrack.datasets.nuscenes.submission import LIDAR_ONLY
from mottrack.formats.nuscenes_records import CHANNEL
from mottrack.formats.nuscenes_splits import split_scenes

FRAMES = 40
TRACKS = 60
"""True tracks a scene; each is there for 44 / 60 of the frames on average."""


class Kind(NamedTuple):
    """What is generated of a category."""

    label: str
    share: float
    """Of all tracks."""
    size_m: list[float]
    """Width, length, height."""


KINDS = {
    "vehicle.car": Kind("car", 0.5, [1.9, 4.6, 1.7]),
    "human.pedestrian.adult": Kind("pedestrian", 0.24, [0.7, 0.7, 1.8]),
    "vehicle.truck": Kind("truck", 0.08, [2.5, 7.0, 3.0]),
    "vehicle.bus.rigid": Kind("bus", 0.03, [2.9, 11.0, 3.5]),
    "vehicle.trailer": Kind("trailer", 0.05, [2.9, 12.0, 3.9]),
    "vehicle.motorcycle": Kind("motorcycle", 0.05, [0.8, 2.1, 1.5]),
    "vehicle.bicycle": Kind("bicycle", 0.05, [0.6, 1.7, 1.3]),
}
LIDAR = token_of("sensor", CHANNEL)
Row = dict[str, Any]
Tables = dict[str, list[Row]]


def write_dataset(root: Path, scenes: int, seed: int) -> int:
    """Write tables, a submission and the list of scenes; return the number of true boxes."""
    rng = np.random.default_rng(seed)
    names = split_scenes("val")[:scenes]
    tables = _empty_tables(list(names))
    results: Tables = {}
    for number, name in enumerate(names):
        _add_scene(rng, tables, results, number, name)
    (root / "v1.0-trainval").mkdir(parents=True)
    (root / MAP_FILE).parent.mkdir()
    (root / MAP_FILE).write_bytes(blank_map())
    for table, rows in tables.items():
        (root / "v1.0-trainval" / f"{table}.json").write_text(json.dumps(rows))
    submission = {"meta": LIDAR_ONLY, "results": results}
    (root / "submission.json").write_text(json.dumps(submission))
    (root / "scenes.txt").write_text("\n".join(names))
    return len(tables["sample_annotation"])


def _empty_tables(scene_names: list[str]) -> Tables:
    names = ("scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation")
    mount = {
        "token": "mount",
        "sensor_token": LIDAR,
        "translation": [0.9, 0.0, 1.8],
        "rotation": [1.0, 0.0, 0.0, 0.0],
        "camera_intrinsic": [],
    }
    empty: Tables = {name: [] for name in names}
    return static_tables(scene_names) | {"calibrated_sensor": [mount]} | empty


def _add_scene(
    rng: np.random.Generator, tables: Tables, results: Tables, number: int, name: str
) -> None:
    origin = rng.uniform(300, 2500, 2)
    ego = origin + np.arange(FRAMES)[:, None] * rng.normal(0, 2, 2)
    tokens = [f"{number:04d}sample{frame:022d}" for frame in range(FRAMES)]
    stamps = 1_530_000_000_000_000 + number * 10**9 + np.arange(FRAMES) * 500_000
    stamps = (stamps + rng.integers(-3000, 3000, FRAMES)).tolist()
    tables["scene"].append(
        {
            "token": name,
            "log_token": token_of("log", name),
            "nbr_samples": FRAMES,
            "first_sample_token": tokens[0],
            "last_sample_token": tokens[-1],
            "name": name,
            "description": "",
        }
    )
    linked = ["", *tokens, ""]
    for frame, token in enumerate(tokens):
        sample = {"token": token, "timestamp": stamps[frame], "scene_token": name}
        links = {"prev": linked[frame], "next": linked[frame + 2]}
        tables["sample"].append(sample | links)
        _add_sweep(tables, token, stamps[frame], ego[frame])
        results[token] = []
    for track in range(TRACKS):
        centre, frames, kind = _true_track(rng, ego)
        _annotate(tables, f"{number:04d}inst{track:024d}", kind, frames, tokens, centre)
        _predict(rng, results, number * 1000 + track, kind, frames, tokens, centre)


def _add_sweep(tables: Tables, token: str, stamp_us: int, ego: F64) -> None:
    pose = {"token": token, "timestamp": stamp_us, "rotation": [1.0, 0.0, 0.0, 0.0]}
    tables["ego_pose"].append(pose | {"translation": [*ego.tolist(), 0.0]})
    tables["sample_data"].append(
        {
            "token": token,
            "sample_token": token,
            "ego_pose_token": token,
            "calibrated_sensor_token": "mount",
            "timestamp": stamp_us,
            "fileformat": "pcd",
            "is_key_frame": True,
            "height": 0,
            "width": 0,
            "filename": "x",
            "prev": "",
            "next": "",
        }
    )


def _true_track(rng: np.random.Generator, ego: F64) -> tuple[F64, range, str]:
    """Return positions in every frame, the frames in which it is there, and the category."""
    kinds = list(KINDS)
    kind = kinds[rng.choice(len(kinds), p=[KINDS[k].share for k in kinds])]
    length = int(np.clip(rng.normal(29.4, 8), 2, FRAMES))
    first = int(rng.integers(0, FRAMES - length + 1))
    start = ego[first + length // 2] + rng.uniform(-32, 32, 2)
    step = rng.normal(0, 0.3, 2) if rng.random() < 0.5 else np.zeros(2)
    centre = start + (np.arange(FRAMES) - first)[:, None] * step
    return np.column_stack([centre, np.zeros(FRAMES)]), range(first, first + length), kind


def _annotate(
    tables: Tables, token: str, kind: str, frames: range, tokens: list[str], centre: F64
) -> None:
    names = [f"{token}{frame}" for frame in frames]
    tables["instance"].append(
        {
            "token": token,
            "category_token": token_of("category", kind),
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
                "size": KINDS[kind].size_m,
                "rotation": [1.0, 0.0, 0.0, 0.0],
                "prev": around[k][0],
                "next": around[k + 1][1],
                "num_lidar_pts": 5,
                "num_radar_pts": 0,
            }
        )


def _predict(
    rng: np.random.Generator,
    results: Tables,
    number: int,
    kind: str,
    frames: range,
    tokens: list[str],
    centre: F64,
) -> None:
    """Add the track seen nine times out of ten, its identity changing, and false ones beside it."""
    identity, score = number * 10, float(rng.beta(4, 2))
    ghost, ghost_score = number * 10 + 9, float(rng.beta(2, 4))
    for frame in frames:
        identity += int(rng.random() < 0.02)
        if rng.random() < 0.9:
            near = centre[frame] + rng.normal(0, 0.35, 3)
            noisy = float(np.clip(score + rng.normal(0, 0.05), 0, 1))
            results[tokens[frame]].append(_box(tokens[frame], identity, kind, near, noisy))
        if rng.random() < 0.1:
            near = centre[frame] + rng.normal(0, 3, 3)
            box = _box(tokens[frame], ghost, kind, near, ghost_score)
            results[tokens[frame]].append(box)


def _box(sample: str, identity: int, kind: str, centre: F64, score: float) -> Row:
    return {
        "sample_token": sample,
        "translation": centre.tolist(),
        "size": KINDS[kind].size_m,
        "rotation": [1.0, 0.0, 0.0, 0.0],
        "velocity": [0.0, 0.0],
        "tracking_id": str(identity),
        "tracking_name": KINDS[kind].label,
        "tracking_score": score,
    }


if __name__ == "__main__":
    print(write_dataset(Path(sys.argv[1]), int(sys.argv[2]), seed=1))
