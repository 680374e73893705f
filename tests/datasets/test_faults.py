"""Damaged files, counted: 100 truncations and 100 flipped bits for each kind of file.

Each read must end in one of three ways: a `DataError` that names the file, the very same values,
or other finite values in range where the format has no means to tell (a flipped bit in a
mantissa, a text cut between two lines). Never another exception, never a NaN.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import DataError, Dataset
from mottrack.datasets.synthetic import SyntheticConfig
from mottrack.datasets.writers import write_synthetic
from tests.datasets.makers import SEED, open_dataset

ROUNDS = 100


def between_points(row_bytes: int) -> Callable[[bytes], bool]:
    return lambda data: len(data) > 0 and len(data) % row_bytes == 0


def whole_last_line(columns: int, separator: str | None = None) -> Callable[[bytes], bool]:
    """The cut fell at the end of a line or inside the last value of one."""
    return lambda data: len((data.decode().splitlines() or [""])[-1].split(separator)) >= columns


def never(_data: bytes) -> bool:
    return False


@dataclass(frozen=True)
class Target:
    """One file of a data set.

    blind: whether the format cannot tell that this content is cut.
    min_flips_reported: of 100 flipped bits at least so many are reported; the rest are changes of
        a value into another value, or of something that is not read.
    """

    format: str
    pattern: str
    blind: Callable[[bytes], bool] = never
    min_flips_reported: int = 0

    @property
    def is_sweep(self) -> bool:
        return "/" in self.pattern and self.pattern.endswith((".bin", "*.feather"))


TARGETS = {
    "kitti sweep": Target("kitti", "training/velodyne/0000/000001.bin", between_points(16)),
    "kitti labels": Target("kitti", "training/label_02/0000.txt", whole_last_line(17), 40),
    "kitti poses": Target("kitti", "training/poses/0000.txt", whole_last_line(12), 40),
    "kitti calibration": Target("kitti", "training/calib/0000.txt", whole_last_line(13), 15),
    "kitti detections": Target(
        "kitti", "detections/pointrcnn/Car/0000.txt", whole_last_line(14, ","), 40
    ),
    "nuscenes sweep": Target("nuscenes", "samples/LIDAR_TOP/*.pcd.bin", between_points(20)),
    "nuscenes sample_data": Target("nuscenes", "v1.0-trainval/sample_data.json", never, 30),
    "nuscenes ego_pose": Target("nuscenes", "v1.0-trainval/ego_pose.json", never, 40),
    "nuscenes annotations": Target("nuscenes", "v1.0-trainval/sample_annotation.json", never, 25),
    "nuscenes detections": Target("nuscenes", "detections/synthetic.json", never, 50),
    "argoverse2 sweep": Target("argoverse2", "val/*/sensors/lidar/*.feather"),
    "argoverse2 annotations": Target("argoverse2", "val/*/annotations.feather", never, 10),
    "argoverse2 poses": Target("argoverse2", "val/*/city_SE3_egovehicle.feather", never, 25),
    "argoverse2 detections": Target("argoverse2", "detections.feather", never, 20),
}


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data)))]


def flip(data: bytes, rng: np.random.Generator) -> bytes:
    place, bit = int(rng.integers(len(data))), int(rng.integers(8))
    damaged = bytearray(data)
    damaged[place] ^= 1 << bit
    return bytes(damaged)


def read_frames(dataset: Dataset) -> list[np.ndarray]:
    """Return poses and boxes of the first scene as arrays."""
    scene = dataset.scene(dataset.scene_names[0])
    values: list[np.ndarray] = []
    for index in range(len(scene)):
        frame = scene.frame(index)
        values.append(frame.world_T_ego.matrix)
        for boxes in (frame.truth, frame.detections):
            if boxes is not None:
                values.extend([boxes.centre_m, boxes.size_m, boxes.yaw_rad])
    return values


def reader(target: Target, root: Path) -> Callable[[], list[np.ndarray]]:
    if not target.is_sweep:
        return lambda: read_frames(open_dataset(target.format, root))
    dataset = open_dataset(target.format, root)
    scene = dataset.scene(dataset.scene_names[0])
    index = 1 if target.format == "kitti" else 0
    return lambda: [scene.sweep(index).xyz_m, scene.sweep(index).reflectance]


def outcome(read: Callable[[], list[np.ndarray]], file: Path, whole: list[np.ndarray]) -> str:
    try:
        values = read()
    except DataError as error:
        if "\n" in str(error):
            return "reported in several lines"
        return "reported" if error.file in (file, *file.parents) else "reported of another file"
    for array in values:
        assert np.isfinite(array).all()
    same = len(values) == len(whole) and all(
        a.shape == b.shape and np.array_equal(a, b) for a, b in zip(values, whole, strict=True)
    )
    return "harmless" if same else "silent"


@pytest.fixture(scope="module")
def small_roots(tmp_path_factory) -> dict[str, Path]:
    """The fewest frames that hold two key frames, as each is read 200 times."""
    folder = tmp_path_factory.mktemp("damaged")
    for name, duration_s in (("kitti", 0.2), ("nuscenes", 0.55), ("argoverse2", 0.2)):
        world = SyntheticConfig(scenes=1, seed=SEED, duration_s=duration_s)
        write_synthetic(folder / name, name, world)
    return {name: folder / name for name in ("kitti", "nuscenes", "argoverse2")}


@pytest.mark.parametrize("name", TARGETS)
def test_damage_is_reported_or_harmless(name, small_roots):
    target = TARGETS[name]
    root = small_roots[target.format]
    file = sorted(root.glob(target.pattern))[0]
    data = file.read_bytes()
    rng = np.random.default_rng(0)
    read = reader(target, root)
    whole = read()
    cuts: Counter[str] = Counter()
    flips: Counter[str] = Counter()
    for _ in range(ROUNDS):
        damaged = cut(data, rng)
        file.write_bytes(damaged)
        result = outcome(read, file, whole)
        assert result != "silent" or target.blind(damaged), len(damaged)
        cuts[result] += 1
        file.write_bytes(flip(data, rng))
        flips[outcome(read, file, whole)] += 1
    file.write_bytes(data)
    print(f"{name}: cut {dict(cuts)}, flipped {dict(flips)}")  # noqa: T201 - shown with -s
    assert "reported in several lines" not in {*cuts, *flips}
    assert flips["reported"] >= target.min_flips_reported
