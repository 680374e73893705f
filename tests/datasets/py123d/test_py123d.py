"""Logs of 123D that py123d's own writer wrote."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from mottrack.core import ConfigError, DataError
from mottrack.datasets.losses import scene_losses
from mottrack.datasets.py123d.config import Py123dConfig
from mottrack.datasets.py123d.dataset import Py123d
from tests.datasets.makers import embedded_scenes
from tests.datasets.py123d.log_writer import write_logs


@pytest.fixture(scope="module")
def scenes():
    return embedded_scenes()


@pytest.fixture(scope="module")
def root(scenes, tmp_path_factory) -> Path:
    pytest.importorskip("py123d", reason="needs the extra: pip install mottrack[py123d]")
    folder = tmp_path_factory.mktemp("logs")
    write_logs(folder, scenes)
    return folder


def test_without_the_extra_the_way_to_it_is_told(tmp_path, monkeypatch):
    (tmp_path / "log").mkdir()
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(ConfigError, match=r"needs its API: pip install 'mottrack\[py123d\]'"):
        Py123d(Py123dConfig(root=tmp_path))


def test_what_was_written_is_read(root, scenes):
    """All but what py123d has no place for: detections, beams and times that were not written."""
    dataset = Py123d(Py123dConfig(root=root))
    for source in scenes:
        read = dataset.scene(source.name)
        lost = {loss.what: loss for loss in scene_losses(source, read)}
        assert lost.keys() == {
            "beams of points",
            "detections left out",
            "labels of true boxes",
            "reflectances rounded",
            "times of points",
        } - ({"labels of true boxes"} if source is scenes[1] else set())
        before = source.frame(1).truth
        after = read.frame(1).truth
        assert len(after) == len(before)
        np.testing.assert_array_equal(after.num_points, np.maximum(before.num_points, 0))


def test_splits_and_frames(root, scenes):
    dataset = Py123d(Py123dConfig(root=root, split="av2-sensor_val", frames=2))
    assert dataset.scene_names == tuple(sorted(scene.name for scene in scenes))
    assert len(dataset.scene(scenes[0].name)) == 2
    with pytest.raises(DataError, match=r"scenes is none, expected <split>/<log>/sync.arrow"):
        _ = Py123d(Py123dConfig(root=root, split="sensors")).scene_names


def copied(root: Path, target: Path) -> Path:
    """Return the first log's folder in a copy of the data set."""
    import shutil

    shutil.copytree(root, target)
    return sorted(path.parent for path in target.glob("**/sync.arrow"))[0]


def read_all(folder: Path) -> None:
    scene = Py123d(Py123dConfig(root=folder.parent)).scene(folder.name)
    scene.frame(0)
    scene.sweep(0)


@pytest.mark.parametrize(
    "file", ["sync", "ego_state_se3", "box_detections_se3", "lidar.lidar_merged"]
)
def test_damaged_files_are_told(file, root, tmp_path):
    folder = copied(root, tmp_path / "copy")
    path = folder / f"{file}.arrow"
    data = path.read_bytes()
    for size in (0, 10, len(data) // 2, len(data) - 3):
        path.write_bytes(data[:size])
        with pytest.raises(DataError) as caught:
            read_all(folder)
        assert caught.value.file.is_relative_to(folder)
        assert "\n" not in str(caught.value)


def test_a_log_that_names_a_foreign_module_is_refused(root, tmp_path):
    """py123d imports the module of the labels that a log names."""
    import msgpack

    folder = copied(root, tmp_path / "copy")
    path = folder / "box_detections_se3.arrow"
    with pa.OSFile(str(path), "rb") as source:
        table = pa.ipc.open_file(source).read_all()
    metadata = msgpack.packb({"box_detection_label_class": "antigravity.Labels"})
    table = table.replace_schema_metadata({b"metadata": metadata})
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)
    with pytest.raises(
        DataError, match=r"is antigravity.Labels, expected a list of labels of py12"
    ):
        Py123d(Py123dConfig(root=tmp_path / "copy")).scene(folder.name)
