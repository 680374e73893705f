"""Opening v1.0-trainval: time and memory on generated tables of the real size.

    python benchmarks/nuscenes_tables.py [--quick] [--json FILE] [--keep FOLDER]

The tables have the real number of rows (2.6 million of sample_data and of ego_pose, 1.17 million
annotations) in the layout of the official files, so their size on disk is the real one too.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from _common import arguments, report

SAMPLES_A_SCENE = 40
SWEEPS = {"LIDAR_TOP": 10} | {f"CAM_{i}": 6 for i in range(6)} | {f"RADAR_{i}": 6 for i in range(5)}
BOXES_A_SAMPLE = 34
START_US = 1_532_402_900_000_000


def token(kind: int, index: int) -> str:
    """A token that looks like an official one: no order, 32 hexadecimal digits."""
    low = (index * 0x9E3779B97F4A7C15 + kind * 0xD1B54A32D192ED03) % 2**64
    return f"{kind:08x}{index:08x}{low:016x}"


def write_rows(path: Path, rows: Iterator[dict[str, Any]]) -> None:
    with path.open("w") as file:
        file.write("[\n")
        for number, row in enumerate(rows):
            file.write((",\n" if number else "") + json.dumps(row, indent=0))
        file.write("\n]")


def write_tables(root: Path, scene_names: list[str]) -> None:
    tables = root / "v1.0-trainval"
    tables.mkdir(parents=True)
    channels = list(SWEEPS)
    samples = len(scene_names) * SAMPLES_A_SCENE
    write_rows(tables / "category.json", iter([{"token": token(1, 0), "name": "vehicle.car"}]))
    write_rows(
        tables / "sensor.json",
        ({"token": token(2, i), "channel": c, "modality": ""} for i, c in enumerate(channels)),
    )
    write_rows(tables / "calibrated_sensor.json", calibrations(len(scene_names), channels))
    write_rows(tables / "scene.json", scenes(scene_names))
    write_rows(tables / "sample.json", (sample(i) for i in range(samples)))
    write_rows(tables / "instance.json", (instance(i) for i in range(len(scene_names) * 76)))
    write_rows(tables / "sample_data.json", sample_data(samples, channels))
    write_rows(
        tables / "ego_pose.json", (ego_pose(i) for i in range(samples * sum(SWEEPS.values())))
    )
    write_rows(tables / "sample_annotation.json", annotations(samples))


def calibrations(scene_count: int, channels: list[str]) -> Iterator[dict[str, Any]]:
    for index in range(scene_count * len(channels)):
        yield {
            "token": token(3, index),
            "sensor_token": token(2, index % len(channels)),
            "translation": [0.943713, 0.0, 1.84023],
            "rotation": [
                0.7077955119163518,
                -0.006492242056004365,
                0.010646214713995808,
                -0.706338,
            ],
            "camera_intrinsic": [],
        }


def scenes(names: list[str]) -> Iterator[dict[str, Any]]:
    for index, name in enumerate(names):
        first = index * SAMPLES_A_SCENE
        yield {
            "token": token(4, index),
            "log_token": token(5, 0),
            "nbr_samples": SAMPLES_A_SCENE,
            "first_sample_token": token(6, first),
            "last_sample_token": token(6, first + SAMPLES_A_SCENE - 1),
            "name": name,
            "description": "generated",
        }


def sample(index: int) -> dict[str, Any]:
    scene, place = divmod(index, SAMPLES_A_SCENE)
    return {
        "token": token(6, index),
        "timestamp": START_US + scene * 60_000_000 + place * 500_000,
        "prev": token(6, index - 1) if place else "",
        "next": token(6, index + 1) if place + 1 < SAMPLES_A_SCENE else "",
        "scene_token": token(4, scene),
    }


def instance(index: int) -> dict[str, Any]:
    return {
        "token": token(7, index),
        "category_token": token(1, 0),
        "nbr_annotations": 18,
        "first_annotation_token": token(8, index),
        "last_annotation_token": token(8, index),
    }


def sample_data(samples: int, channels: list[str]) -> Iterator[dict[str, Any]]:
    index = 0
    for number in range(samples):
        scene, place = divmod(number, SAMPLES_A_SCENE)
        start = START_US + scene * 60_000_000 + place * 500_000
        for position, channel in enumerate(channels):
            for step in range(SWEEPS[channel]):
                stamp = start + step * 500_000 // SWEEPS[channel]
                folder = "samples" if step == 0 else "sweeps"
                yield {
                    "token": token(9, index),
                    "sample_token": token(6, number),
                    "ego_pose_token": token(10, index),
                    "calibrated_sensor_token": token(3, scene * len(channels) + position),
                    "timestamp": stamp,
                    "fileformat": "pcd",
                    "is_key_frame": step == 0,
                    "height": 0,
                    "width": 0,
                    "filename": f"{folder}/{channel}/n015-2018-07-18-11-07-57+0800__{channel}__"
                    f"{stamp}.pcd.bin",
                    "prev": "",
                    "next": "",
                }
                index += 1


def ego_pose(index: int) -> dict[str, Any]:
    return {
        "token": token(10, index),
        "timestamp": START_US + index,
        "rotation": [
            0.5720320396729045,
            -0.0016977771610471074,
            0.011798001930183783,
            -0.820145642,
        ],
        "translation": [411.3039349319818 + index * 1e-4, 1180.8903791765097, 0.0],
    }


def annotations(samples: int) -> Iterator[dict[str, Any]]:
    for number in range(samples):
        scene, _ = divmod(number, SAMPLES_A_SCENE)
        for box in range(BOXES_A_SAMPLE):
            yield {
                "token": token(8, number * BOXES_A_SAMPLE + box),
                "sample_token": token(6, number),
                "instance_token": token(7, scene * 76 + box),
                "visibility_token": "4",
                "attribute_tokens": [token(11, 0)],
                "translation": [373.256 + box, 1130.419 + number % SAMPLES_A_SCENE, 0.8],
                "size": [0.621, 0.669, 1.642],
                "rotation": [0.9831098797903927, 0.0, 0.0, -0.18301629506281616],
                "prev": "",
                "next": "",
                "num_lidar_pts": 1,
                "num_radar_pts": 0,
            }


def measure(root: Path, split: str, cache: Path) -> dict[str, float]:
    """Opens the set in this process; the caller runs it in a fresh one."""
    from mottrack.datasets.nuscenes.config import NuScenesConfig
    from mottrack.datasets.nuscenes.dataset import NuScenes

    wall, cpu = time.perf_counter(), time.process_time()
    dataset = NuScenes(NuScenesConfig(root=root, split=split, cache_dir=cache))
    scene = dataset.scene(dataset.scene_names[0])
    truth = scene.frame(len(scene) - 1).truth
    return {
        "scenes": len(dataset.scene_names),
        "boxes_last_frame": -1 if truth is None else len(truth),
        "wall_s": time.perf_counter() - wall,
        "cpu_s": time.process_time() - cpu,
        "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def in_new_process(root: Path, split: str, cache: Path) -> dict[str, float]:
    command = [sys.executable, __file__, "--measure", str(root), split, str(cache)]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    result: dict[str, float] = json.loads(output)
    return result


def main() -> None:
    from mottrack.formats.nuscenes_splits import split_scenes

    options = arguments(__doc__ or "", keep=Path)
    names = [*split_scenes("train"), *split_scenes("val")]
    names = names[-30:] if options.quick else names
    with tempfile.TemporaryDirectory() as temporary:
        root = options.keep or Path(temporary)
        if not (root / "v1.0-trainval").is_dir():
            write_tables(root, names)
        gigabytes = sum(p.stat().st_size for p in root.rglob("*.json")) / 1e9
        rows = []
        for split in ("val",) if options.quick else ("val", "train"):
            with tempfile.TemporaryDirectory() as cache:
                for run in ("first", "again"):
                    figures = in_new_process(root, split, Path(cache))
                    rows.append({"split": split, "open": run, "tables_gb": gigabytes} | figures)
    report(rows, options.json)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:
        print(json.dumps(measure(Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4]))))
    else:
        main()
