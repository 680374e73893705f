"""Laws that every data set of the table `DATASETS` keeps: one body over all of them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import ConfigError, DataError, Dataset, InputError, Scene
from mottrack.datasets import DATASETS
from mottrack.datasets.vehicle import VehicleOutline
from mottrack.lidar.in_boxes import points_in_boxes
from tests.datasets.makers import MAKERS, maker, open_dataset

ON_DISK = [kind for kind in DATASETS if kind not in MAKERS or MAKERS[kind].write]
NAMING_FILES = [kind for kind in ON_DISK if kind not in MAKERS or MAKERS[kind].escape]


@pytest.fixture(scope="module")
def root_of(tmp_path_factory) -> Callable[[str], Path]:
    """Return the folder of a kind's small instance, which is written once."""
    roots: dict[str, Path] = {}

    def root(kind: str) -> Path:
        if kind not in roots:
            made, folder = maker(kind), tmp_path_factory.mktemp(kind)
            if made.write:
                made.write(folder)
            roots[kind] = folder  # of a kind that skips, nothing is kept
        return roots[kind]

    return root


@pytest.fixture(params=DATASETS)
def dataset(request, root_of) -> Dataset:
    return open_dataset(request.param, root_of(request.param))


@pytest.fixture
def scene(dataset) -> Scene:
    return dataset.scene(dataset.scene_names[0])


@pytest.fixture(params=DATASETS)
def opened_twice(request, root_of) -> tuple[Dataset, Dataset]:
    kind = request.param
    return open_dataset(kind, root_of(kind)), open_dataset(kind, root_of(kind))


def test_makers_make_what_the_table_names():
    assert MAKERS.keys() <= DATASETS.keys()


def test_implements_the_protocols(dataset, scene):
    assert isinstance(dataset, Dataset)
    assert dataset.name in DATASETS
    assert isinstance(scene, Scene)
    assert len(scene) > 1
    assert scene.has_sweeps


def test_scene_names_are_unique_and_name_the_scenes(dataset):
    names = dataset.scene_names
    assert isinstance(names, tuple)
    assert len(set(names)) == len(names) > 1
    assert [dataset.scene(name).name for name in names] == list(names)


def test_an_unknown_scene_is_refused_with_the_nearest_name(dataset):
    for name in dataset.scene_names:
        near = f"{name}x"
        with pytest.raises(ConfigError, match=f"unknown scene '{near}' .did you mean '{name}'"):
            dataset.scene(near)


def test_a_scene_outside_the_root_is_refused(dataset, tmp_path):
    for name in ("../elsewhere", str(tmp_path), ".", ""):
        with pytest.raises(ConfigError, match="unknown scene"):
            dataset.scene(name)


def test_frames_are_in_order_of_time_with_integer_stamps(scene):
    stamps = [scene.frame(i).stamp_ns for i in range(len(scene))]
    assert {type(stamp) for stamp in stamps} == {int}
    assert (np.diff(stamps) > 0).all()
    assert any(scene.frame(i).is_key for i in range(len(scene)))


def test_a_sweep_has_the_stamp_and_the_pose_of_its_frame(scene):
    for index in range(len(scene)):
        sweep, frame = scene.sweep(index), scene.frame(index)
        assert len(sweep) > 100
        assert sweep.stamp_ns == frame.stamp_ns
        np.testing.assert_array_equal(sweep.world_T_ego.matrix, frame.world_T_ego.matrix)


def test_boxes_are_in_the_world(scene):
    """Returns lie in the boxes once those are moved into the ego frame by the frame's pose."""
    boxes_read = returns = 0
    for index in range(len(scene)):
        frame = scene.frame(index)
        for boxes in (frame.truth, frame.detections):
            if boxes is not None:
                assert boxes.frame == "world"
                ego = boxes.transformed(frame.world_T_ego.inverse(), "ego")
                xyz_m = scene.sweep(index).xyz_m
                found = points_in_boxes(xyz_m, ego.centre_m, ego.size_m, ego.yaw_rad)
                boxes_read += len(boxes)
                returns += found.start[-1]
    assert returns >= 10 * boxes_read


def test_detections_have_labels_of_the_scene(scene):
    assert scene.classes
    for index in range(len(scene)):
        detections = scene.frame(index).detections
        if detections is not None:
            assert set(detections.label.tolist()) <= set(scene.classes)


def same(one: object, other: object) -> bool:
    """Whether two values are equal to the bit, arrays and NaN included."""
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.tobytes() == other.tobytes()
    if is_dataclass(one):
        names = [f.name for f in fields(one)]
        return type(one) is type(other) and all(
            same(getattr(one, name), getattr(other, name)) for name in names
        )
    return one == other


def test_opening_twice_gives_the_same(opened_twice):
    one, other = opened_twice
    assert one.scene_names == other.scene_names
    for name in one.scene_names:
        first, second = one.scene(name), other.scene(name)
        assert len(first) == len(second)
        assert first.classes == second.classes
        # in another order, so that nothing depends on what was read before
        late = {i: (second.frame(i), second.sweep(i)) for i in reversed(range(len(second)))}
        for index in range(len(first)):
            assert same(first.frame(index), late[index][0])
            assert same(first.sweep(index), late[index][1])


def test_an_index_out_of_range_is_refused(scene):
    for index in (-1, len(scene)):
        for read in (scene.frame, scene.sweep):
            with pytest.raises(InputError, match=f"index is {index}, expected"):
                read(index)


@pytest.mark.parametrize("kind", ON_DISK)
def test_a_truncated_sweep_is_named(kind, root_of, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(root_of(kind), root)
    path = sorted(root.glob(maker(kind).first_sweep))[0]
    path.write_bytes(path.read_bytes()[:-3])
    dataset = open_dataset(kind, root)
    with pytest.raises(DataError) as caught:
        dataset.scene(dataset.scene_names[0]).sweep(0)
    assert caught.value.file == path


@pytest.mark.parametrize("kind", NAMING_FILES)
def test_files_outside_the_root_are_refused(kind, root_of, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(root_of(kind), root)
    shutil.copytree(root, tmp_path / "elsewhere")
    settings = maker(kind).escape(root)

    def read_all():
        dataset = open_dataset(kind, root, **settings)
        scene = dataset.scene(dataset.scene_names[0])
        return scene.frame(0), scene.sweep(0)

    with pytest.raises(DataError, match="inside the data root"):
        read_all()


AHEAD = VehicleOutline(front_m=20.0, rear_m=2.0, side_m=5.0)
"""Large enough to hold returns of the road in any sweep."""


def first_sweep(kind, root, **settings):
    dataset = open_dataset(kind, root, **settings)
    return dataset.scene(dataset.scene_names[0]).sweep(0)


@pytest.mark.parametrize("kind", ON_DISK)
def test_the_outline_is_cut_as_configured(kind, root_of):
    whole = first_sweep(kind, root_of(kind), vehicle=None)
    cut = first_sweep(kind, root_of(kind), vehicle=AHEAD.model_dump())
    assert 0 < len(cut) < len(whole)
    assert len(AHEAD.cut(cut)) == len(cut)
    known = {"kitti", "nuscenes", "argoverse2"}
    default = first_sweep(kind, root_of(kind))
    assert len(default) == len(whole) or kind in known
    if kind == "nuscenes":  # the rehearsal alone has a body
        assert len(default) < len(whole)


def test_a_part_of_an_outline_is_refused(root_of):
    with pytest.raises(ConfigError, match=r"vehicle\.rear_m"):
        first_sweep("nuscenes", root_of("nuscenes"), vehicle={"front_m": 3.0, "side_m": 1.0})
