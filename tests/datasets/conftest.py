"""The same second of the embedded world, written in every format and read back."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest

from mottrack.core import Pose, Scene
from mottrack.datasets.nuscenes.rehearsal import RehearsalScene
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset
from mottrack.datasets.writers import FORMATS, write_synthetic
from tests.datasets.makers import SEED, open_dataset

DURATION_S = 1.05


@dataclass(frozen=True)
class Written:
    """A scene of the embedded world and the same scene read from a data set on disk."""

    format: str
    root: Path
    source: Scene
    read: Scene

    @property
    def read_T_source(self) -> Pose:
        """KITTI's world starts at the first frame; the others keep the world."""
        return self.read.frame(0).world_T_ego @ self.source.frame(0).world_T_ego.inverse()


class Recorded:
    """A scene kept in memory, so that each sweep is cast or read once for all tests."""

    def __init__(self, scene: Scene) -> None:
        self.name, self.classes, self.has_sweeps = scene.name, scene.classes, scene.has_sweeps
        self.frames = [scene.frame(i) for i in range(len(scene))]
        self.sweeps = [scene.sweep(i) for i in range(len(scene))]

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, index):
        return self.frames[index]

    def sweep(self, index):
        return self.sweeps[index]


def source_scene(format_name: str) -> Scene:
    chosen = FORMATS.get(format_name, FORMATS["nuscenes"])
    config = SyntheticConfig(
        scenes=1,
        seed=SEED,
        duration_s=DURATION_S,
        sweep_hz=chosen.sweep_hz,
        key_hz=chosen.key_hz,
    )
    world = SyntheticDataset(config)
    scene = world.scene(world.scene_names[0])
    return RehearsalScene(scene) if format_name == "nuscenes" else scene


@pytest.fixture(scope="session")
def written_roots(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("written")
    names = [name for name in FORMATS if name != "ros" or find_spec("rosbags")]
    for name in names:
        world = SyntheticConfig(scenes=1, seed=SEED, duration_s=DURATION_S)
        write_synthetic(folder / name, name, world)
    return {name: folder / name for name in names}


@pytest.fixture(params=["synthetic", *FORMATS], scope="session")
def written(request, written_roots) -> Written:
    name = request.param
    if name == "ros":
        pytest.importorskip("rosbags", reason="needs the extra: pip install mottrack[ros]")
    source = Recorded(source_scene(name))
    if name == "synthetic":
        return Written(name, Path(), source, source)
    # whole sweeps: what readers cut of their vehicle has a test of its own
    dataset = open_dataset(name, written_roots[name], vehicle=None)
    scene = dataset.scene(dataset.scene_names[0])
    return Written(name, written_roots[name], source, Recorded(scene))
