"""The same two seconds of the embedded world, written in every format and read back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from mottrack.core import Pose, Scene
from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.argoverse2.dataset import Argoverse2
from mottrack.datasets.kitti.config import KittiConfig
from mottrack.datasets.kitti.dataset import Kitti
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset
from mottrack.datasets.writers import FORMATS, write_synthetic

DURATION_S = 1.05
SEED = 3


def open_kitti(root: Path) -> Kitti:
    return Kitti(KittiConfig(root=root))


def open_nuscenes(root: Path) -> NuScenes:
    detections = Path(FORMATS["nuscenes"].detections)
    return NuScenes(NuScenesConfig(root=root, split="val", rate_hz=20, detections=detections))


def open_argoverse2(root: Path) -> Argoverse2:
    detections = Path(FORMATS["argoverse2"].detections)
    return Argoverse2(Argoverse2Config(root=root, detections=detections))


OPEN: dict[str, Callable[[Path], object]] = {
    "kitti": open_kitti,
    "nuscenes": open_nuscenes,
    "argoverse2": open_argoverse2,
}


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
    return world.scene(world.scene_names[0])


@pytest.fixture(scope="session")
def written_roots(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("written")
    for name in OPEN:
        write_synthetic(folder / name, name, 1, seed=SEED, duration_s=DURATION_S)
    return {name: folder / name for name in OPEN}


@pytest.fixture(params=["synthetic", *OPEN], scope="session")
def written(request, written_roots) -> Written:
    name = request.param
    source = Recorded(source_scene(name))
    if name == "synthetic":
        return Written(name, Path(), source, source)
    dataset = OPEN[name](written_roots[name])
    scene = dataset.scene(dataset.scene_names[0])
    return Written(name, written_roots[name], source, Recorded(scene))


@pytest.fixture(scope="session")
def opened(written_roots) -> Callable[[str], object]:
    """Opens the written data set of a format anew."""
    return lambda name: OPEN[name](written_roots[name])
