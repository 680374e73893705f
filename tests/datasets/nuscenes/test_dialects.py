"""Autoware's T4 and MAN TruckScenes: what differs from nuScenes."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import ConfigError, DataError
from mottrack.datasets.check import kind_of_folder
from mottrack.datasets.nuscenes.config import T4Config, TruckScenesConfig
from mottrack.datasets.nuscenes.dataset import TruckScenes
from mottrack.datasets.nuscenes.t4 import T4
from mottrack.datasets.nuscenes.truckscenes_splits import truckscenes_splits


@pytest.fixture
def t4(written_roots, tmp_path) -> Path:
    """A folder with one data set in T4 format."""
    shutil.copytree(written_roots["t4"], tmp_path / "t4")
    return next(path for path in (tmp_path / "t4").iterdir() if (path / "annotation").is_dir())


def edit(folder: Path, table: str, change) -> None:
    path = folder / "annotation" / f"{table}.json"
    path.write_text(json.dumps([change(row) for row in json.loads(path.read_text())]))


def opened(root: Path, **settings):
    dataset = T4(T4Config(root=root, **settings))
    return dataset.scene(dataset.scene_names[0])


def test_the_kind_is_told_by_the_layout(written_roots, t4):
    assert kind_of_folder(written_roots["truckscenes"]) == "truckscenes"
    assert kind_of_folder(written_roots["nuscenes"]) == "nuscenes"
    assert kind_of_folder(t4.parent) == kind_of_folder(t4) == "t4"


def test_a_data_set_may_be_the_root_or_lie_in_a_version(t4):
    whole = opened(t4.parent)
    assert opened(t4).name == whole.name == t4.name
    content = list(t4.iterdir())
    for number in ("9", "10"):
        (t4 / number).mkdir()
    for path in content:
        shutil.copytree(path, t4 / "9" / path.name) if path.is_dir() else None
        path.rename(t4 / "10" / path.name)
    edit(t4 / "9", "sample", lambda row: row | {"timestamp": 1})
    newest = opened(t4.parent)
    assert newest.name == t4.name
    assert newest.frame(0).stamp_ns == whole.frame(0).stamp_ns
    assert len(newest.sweep(0)) > 1000


def test_old_categories_another_channel_and_no_annotations(t4):
    labels = set(opened(t4).frame(0).truth.label.tolist())
    assert "car" in labels
    old = {"car": "vehicle.emergency (ambulance & police)", "pedestrian": "pedestrian.adult"}
    edit(t4, "category", lambda row: row | {"name": old.get(row["name"], row["name"])})
    edit(t4, "sensor", lambda row: row | {"channel": "LIDAR_TOP"})
    assert set(opened(t4).frame(0).truth.label.tolist()) == labels
    for name in ("instance", "sample_annotation", "category", "attribute", "visibility"):
        (t4 / "annotation" / f"{name}.json").write_text("[]")
    scene = opened(t4)
    assert scene.frame(0).truth is None
    assert len(scene.sweep(0)) > 1000
    edit(t4, "sensor", lambda row: row | {"channel": "LIDAR_FRONT"})
    with pytest.raises(DataError, match="channel is missing, expected LIDAR_CONCAT or LIDAR_TOP"):
        opened(t4)


def test_a_folder_without_a_data_set_and_one_with_two_scenes(t4, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "readme").write_text("")
    with pytest.raises(DataError, match="scenes is none, expected <data set>/annotation or"):
        _ = T4(T4Config(root=tmp_path / "empty")).scene_names
    path = t4 / "annotation" / "scene.json"
    row = json.loads(path.read_text())[0]
    path.write_text(json.dumps([row, row | {"token": "other", "name": "other"}]))
    with pytest.raises(DataError, match="scenes is 2, expected one"):
        opened(t4)


SPLITS = {
    "train": (523, "049eab2f322fa0a0"),
    "val": (75, "79c83d02eb6793f3"),
    "test": (149, "1e0eea8d32625199"),
    "mini_train": (8, "f44884a2c8fc01f0"),
    "mini_val": (2, "4d34a6f279bb321e"),
}
"""Number of scenes, and the SHA-256 of their sorted names, of truckscenes-devkit 1.2.0."""


def test_the_splits_of_truckscenes_are_the_devkits():
    found = {
        split: (len(names), hashlib.sha256("\n".join(sorted(names)).encode()).hexdigest()[:16])
        for split, names in truckscenes_splits().items()
    }
    assert found == SPLITS


def test_truckscenes_by_split_and_rate(written_roots):
    root = written_roots["truckscenes"]
    dataset = TruckScenes(TruckScenesConfig(root=root, split="val", rate_hz=2))
    scene = dataset.scene(dataset.scene_names[0])
    assert all(scene.frame(i).is_key for i in range(len(scene)))
    assert "other_vehicle" in scene.classes
    with pytest.raises(DataError, match="expected scenes of split test"):
        _ = TruckScenes(TruckScenesConfig(root=root, split="test")).scene_names
    with pytest.raises(ConfigError, match="unknown split 'vall'"):
        _ = TruckScenes(TruckScenesConfig(root=root, split="vall")).scene_names


def test_six_lidars_of_different_times_are_one_sweep(written_roots, tmp_path):
    """Each saw a sixth of the points 2 ms after the one before, from another pose."""
    shutil.copytree(written_roots["truckscenes"], tmp_path / "truck")
    settings = {"root": tmp_path / "truck", "split": "val"}
    dataset = TruckScenes(TruckScenesConfig(**settings))
    scene = dataset.scene(dataset.scene_names[0])
    whole = scene.sweep(0)
    offsets_us = np.unique(whole.time_offset_ns) // 1000
    assert offsets_us.tolist() == [0, 2000, 4000, 6000, 8000, 10000]
    # without the sweeps of one, near that time, the others are what is left
    path = tmp_path / "truck" / "v1.0-trainval" / "sample_data.json"
    rows = json.loads(path.read_text())
    kept = [row for row in rows if "LIDAR_REAR" not in row["filename"]]
    assert len(kept) < len(rows)
    path.write_text(json.dumps(kept))
    dataset = TruckScenes(TruckScenesConfig(**settings))
    part = dataset.scene(scene.name).sweep(0)
    assert len(part) == len(whole) - np.count_nonzero(whole.time_offset_ns == 10_000_000)
