"""Data sets converted between formats: what survives, and that what does not is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core import ConfigError, Dataset, VelocityMeasurement
from mottrack.datasets.convert import Target, convert
from mottrack.datasets.losses import scene_losses
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset
from mottrack.datasets.writers import FORMATS
from mottrack.experiment.plugins import load_part
from tests.datasets.makers import SEED

COUNTED, ROUNDED = "numbers of points in true boxes", "reflectances rounded"
NAMES = "labels of true boxes"
BEAMS, TIMES, PLACES = "beams of points", "times of points", "places of the sensor"
LOST = {
    "nuscenes": {ROUNDED, TIMES, NAMES},
    "t4": {ROUNDED, TIMES, BEAMS, PLACES},
    "truckscenes": {ROUNDED, BEAMS, PLACES, NAMES, "times of points moved"},
    "kitti": {
        COUNTED,
        TIMES,
        BEAMS,
        PLACES,
        "detections left out",
        "labels of detections",
        NAMES,
        "true boxes left out",
        "velocities of detections",
        "world: it starts elsewhere, poses are those of another frame",
    },
    "argoverse2": {ROUNDED, "points moved", "velocities of detections"},
    "folder": {COUNTED, PLACES, "velocities of detections"},
    "ros": {COUNTED, "velocities of detections"},
}
"""What a format cannot hold of the embedded world; an empty set would be a format without loss."""


def opener(settings):
    return load_part("dataset", dict(settings)).make()


class WithVelocities:
    """The embedded world with a detector that measures velocities."""

    name = "synthetic"

    def __init__(self, whole) -> None:
        self._whole, self.scene_names = whole, whole.scene_names

    def scene(self, name):
        return FastScene(self._whole.scene(name))


class FastScene:
    """A scene whose detections all drive 3 m/s to the north."""

    def __init__(self, scene) -> None:
        self._scene, self.sweep = scene, scene.sweep
        self.name, self.classes, self.has_sweeps = scene.name, scene.classes, scene.has_sweeps

    def __len__(self) -> int:
        return len(self._scene)

    def frame(self, index):
        frame = self._scene.frame(index)
        count = len(frame.detections)
        moving = VelocityMeasurement(
            np.tile([0.0, 3.0], (count, 1)), np.tile(np.eye(2), (count, 1, 1)), np.ones(count, bool)
        )
        return replace(frame, detections=frame.detections.with_velocity(moving))


@pytest.fixture(scope="module")
def world() -> Dataset:
    config = SyntheticConfig(scenes=1, seed=SEED, duration_s=0.35, key_hz=10)
    return WithVelocities(SyntheticDataset(config))


@pytest.fixture(scope="module")
def converted(world, tmp_path_factory):
    """Convert to a format once."""
    kept: dict[str, tuple[Path, set[str]]] = {}

    def to(name: str) -> tuple[Path, set[str]]:
        if name not in kept:
            root = tmp_path_factory.mktemp("converted") / name
            (scene,) = convert(world, Target(root, name), opener)
            kept[name] = root, {loss.what for loss in scene.losses}
        return kept[name]

    return to


@pytest.mark.parametrize("name", FORMATS)
def test_what_a_format_loses_is_told_and_nothing_else_is_lost(name, converted):
    pytest.importorskip("rosbags" if name == "ros" else "numpy")
    assert converted(name)[1] == LOST[name]


@pytest.mark.parametrize("by", ["ros", "nuscenes", "argoverse2"])
def test_there_and_back_is_what_was_sent(by, converted, tmp_path):
    """From the folder format by another one and back: what the first lost is not lost again."""
    pytest.importorskip("rosbags", reason="needs the extra: pip install mottrack[ros]")
    start = opener({"kind": "folder", "root": str(converted("folder")[0])})
    (there,) = convert(start, Target(tmp_path / "there", by), opener)
    reader = dict(FORMATS[by].reader)
    if by == "ros":
        reader |= {"detections_topic": "/detections", "truth_topic": "/truth"}
    else:
        reader |= {"detections": FORMATS[by].detections}
    settings = {"kind": by, "root": str(tmp_path / "there"), "vehicle": None, **reader}
    (back,) = convert(opener(settings), Target(tmp_path / "back", "folder"), opener)
    end = opener({"kind": "folder", "root": str(tmp_path / "back")}).scene(back.name)
    lost = {loss.what for loss in scene_losses(start.scene(there.source), end)}
    of_the_way = {
        "argoverse2": {ROUNDED, "points moved"},
        "nuscenes": {ROUNDED, TIMES, NAMES},
        "ros": set(),
    }
    assert lost == of_the_way[by]


def test_the_command(converted, tmp_path):
    root = converted("folder")[0]
    run = CliRunner().invoke(app, ["convert", str(root), str(tmp_path / "kitti"), "--to", "kitti"])
    assert run.exit_code == 0, run.output
    assert f"{next(root.iterdir()).name} -> 0000" in run.output
    assert "lost or changed: true boxes left out:" in run.output
    assert "1 scenes in kitti format" in run.output


def test_a_view_that_bounds_the_labels_is_told(converted):
    """KITTI labels what its camera sees: elsewhere a track is no error, which others can't say."""
    kitti = opener({"kind": "kitti", "root": str(converted("kitti")[0])}).scene("0000")
    folder = opener({"kind": "folder", "root": str(converted("folder")[0])})
    lost = {loss.what for loss in scene_losses(kitti, folder.scene(folder.scene_names[0]))}
    assert "views within which objects are labelled" in lost


def test_refusals(world, tmp_path):
    with pytest.raises(ConfigError, match=r"unknown format 'kiti' .did you mean 'kitti'"):
        list(convert(world, Target(tmp_path / "a", "kiti"), opener))
    with pytest.raises(ConfigError, match=r"unknown version of kitti"):
        list(convert(world, Target(tmp_path / "a", "kitti", "v1"), opener))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("")
    with pytest.raises(ConfigError, match="is not empty, expected a new folder"):
        list(convert(world, Target(tmp_path / "full", "kitti"), opener))
