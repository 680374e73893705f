"""A small instance of every data set, by its name in `DATASETS`.

A data set that is added to the table needs a maker here; the contract tests then run over it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import Dataset, Scene
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset
from mottrack.datasets.writers import FORMATS, write_synthetic
from mottrack.experiment.plugins import load_part
from mottrack.formats.rigid import quaternion_wxyz
from tests.datasets.py123d.log_writer import write_logs

SEED = 5
DURATION_S = 0.55
"""Two key frames of nuScenes, 20 Hz with key frames at 2 Hz."""
SCENES = 2
Settings = Mapping[str, object]


@dataclass(frozen=True)
class Maker:
    """How a small data set of a kind is made, opened and damaged.

    write: writes at least two scenes into an empty folder; None where nothing is on disk.
    settings: settings of the reader beside the root.
    first_sweep: pattern of files; the first in order of name is the first sweep of the first scene.
    escape: makes the data set name a file outside its root, and returns settings that do so; None
        where neither its files nor its settings name files.
    """

    write: Callable[[Path], object] | None = None
    settings: Settings = field(default_factory=dict)
    first_sweep: str = ""
    escape: Callable[[Path], Settings] | None = None


def open_dataset(kind: str, root: Path, **settings: object) -> Dataset:
    """Open a data set as an experiment does."""
    made = maker(kind)
    rooted = {"root": str(root)} if made.write else {}
    return load_part("dataset", {"kind": kind, **rooted, **made.settings, **settings}).make()


def maker(kind: str) -> Maker:
    if kind not in MAKERS:
        pytest.fail(f"data set '{kind}' has no maker: add one to {__file__}")
    return MAKERS[kind]


def format_writer(name: str) -> Callable[[Path], object]:
    world = SyntheticConfig(scenes=SCENES, seed=SEED, duration_s=DURATION_S)
    return lambda root: write_synthetic(root, name, world)


def embedded_scenes(sweep_hz: int = 10, key_hz: int = 10) -> list[Scene]:
    config = SyntheticConfig(
        scenes=SCENES, seed=SEED, duration_s=DURATION_S, sweep_hz=sweep_hz, key_hz=key_hz
    )
    world = SyntheticDataset(config)
    return [world.scene(name) for name in world.scene_names]


def write_folder(root: Path) -> None:
    for scene in embedded_scenes():
        write_own_log(root / scene.name, scene)


def write_own_log(folder: Path, scene: Scene) -> None:
    """Write a scene in the format of docs/own_logs.md."""
    (folder / "sweeps").mkdir(parents=True)
    poses = ["stamp_ns,x,y,z,qw,qx,qy,qz"]
    boxes = ["stamp_ns,id,label,x,y,z,length,width,height,yaw"]
    detections = ["stamp_ns,label,score,x,y,z,length,width,height,yaw"]
    for index in range(len(scene)):
        frame, sweep = scene.frame(index), scene.sweep(index)
        ego_T_world, stamp = frame.world_T_ego.inverse(), frame.stamp_ns
        pose = [*frame.world_T_ego.translation_m, *quaternion_wxyz(frame.world_T_ego.rotation)]
        poses.append(row(stamp, *pose))
        truth, found = (b.transformed(ego_T_world, "ego") for b in (frame.truth, frame.detections))
        boxes += [
            row(stamp, truth.id[i], truth.label[i], *geometry(truth, i)) for i in range(len(truth))
        ]
        detections += [
            row(stamp, found.label[i], found.score[i], *geometry(found, i))
            for i in range(len(found))
        ]
        values = np.column_stack([sweep.xyz_m, sweep.reflectance]).astype("<f4")
        values.tofile(folder / f"sweeps/{stamp}.bin")
    for name, rows in (("poses", poses), ("boxes", boxes), ("detections", detections)):
        (folder / f"{name}.csv").write_text("\n".join(rows) + "\n")


def row(*values: object) -> str:
    return ",".join(map(str, values))


def geometry(boxes, index: int) -> list[float]:
    return [*boxes.centre_m[index], *boxes.size_m[index], boxes.yaw_rad[index]]


def write_ros(root: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra: pip install mottrack[ros]")
    format_writer("ros")(root)


def write_py123d(root: Path) -> None:
    pytest.importorskip("py123d", reason="needs the extra: pip install mottrack[py123d]")
    write_logs(root, embedded_scenes())


def escape_from_t4(root: Path) -> Settings:
    return escaped(sorted(root.glob("*/annotation/sample_data.json"))[0])


def escape_from_nuscenes(root: Path) -> Settings:
    return escaped(root / "v1.0-trainval/sample_data.json")


def escaped(path: Path) -> Settings:
    rows = json.loads(path.read_text())
    for record in rows:
        record["filename"] = f"../{record['filename']}"
    path.write_text(json.dumps(rows))
    return {}


MAKERS: dict[str, Maker] = {
    "argoverse2": Maker(
        format_writer("argoverse2"),
        {"detections": FORMATS["argoverse2"].detections},
        "val/*/sensors/lidar/*.feather",
        lambda _: {"split": "../elsewhere"},
    ),
    "folder": Maker(write_folder, {}, "*/sweeps/*.bin"),
    "kitti": Maker(
        format_writer("kitti"),
        {},
        "training/velodyne/*/*.bin",
        lambda _: {"detections": "../elsewhere"},
    ),
    "nuscenes": Maker(
        format_writer("nuscenes"),
        {"split": "val", "rate_hz": 20, "detections": FORMATS["nuscenes"].detections},
        "samples/LIDAR_TOP/*.pcd.bin",
        escape_from_nuscenes,
    ),
    "py123d": Maker(
        write_py123d, {}, "*/*/lidar.lidar_merged.arrow", lambda _: {"split": "../elsewhere"}
    ),
    "ros": Maker(write_ros, {"detections_topic": "/detections", "truth_topic": "/truth"}, "*.mcap"),
    "t4": Maker(
        format_writer("t4"),
        {"detections": FORMATS["t4"].detections},
        "*/data/LIDAR_CONCAT/*.pcd.bin",
        escape_from_t4,
    ),
    "truckscenes": Maker(
        format_writer("truckscenes"),
        {"split": "val", "detections": FORMATS["truckscenes"].detections},
        "samples/LIDAR_LEFT/*.pcd",
        escape_from_nuscenes,
    ),
    "synthetic": Maker(settings={"scenes": SCENES, "seed": SEED, "duration_s": DURATION_S}),
}
