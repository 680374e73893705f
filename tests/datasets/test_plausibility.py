"""What is possible value by value and hardly meant: each is told, and whole data raise nothing."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core import Frame, Objects, Pose, Truth
from mottrack.datasets.plausibility.watch import SceneWatch

SECOND = 1_000_000_000
FRAMES = 24


class Scene:
    """Only what a watch asks of a scene."""

    classes = ("car", "pedestrian")


def frame(index: int) -> Frame:
    """A vehicle at 10 m/s along x, and two cars of 5 m/s beside it, annotated and detected."""
    stamp = index * SECOND // 10
    x_m = 1.0 * index
    centre = np.array([[x_m + 10.0, 4.0, 0.0], [0.5 * index, -4.0, 0.0]])
    shared = {"stamp_ns": stamp, "centre_m": centre, "size_m": np.tile([4.0, 2.0, 1.5], (2, 1))}
    truth = Truth(
        **shared,
        yaw_rad=np.zeros(2),
        label=np.array(["car", "car"]),
        id=np.array([1, 2]),
        velocity_mps=np.tile([5.0, 0.0], (2, 1)),
        num_points=np.array([9, 9]),
        interpolated=np.zeros(2, bool),
    )
    found = Objects(
        **shared, yaw_rad=np.array([0.01, index * 1e-3]), label=truth.label, score=np.full(2, 0.5)
    )
    pose = Pose.from_yaw(0.0, [x_m, 0.0, 0.0])
    return Frame(stamp_ns=stamp, world_T_ego=pose, detections=found, truth=truth)


def moved(boxes, offset_m: list[float]):
    return replace(boxes, centre_m=boxes.centre_m + offset_m)


def watched(change: Callable[[int, Frame], Frame] = lambda _, f: f) -> list[str]:
    watch = SceneWatch(Scene())
    for index in range(FRAMES):
        watch.add(change(index, frame(index)))
    return [str(concern) for concern in watch.concerns()]


def test_a_whole_scene_raises_nothing() -> None:
    assert watched() == []


def pose(x_m: float, yaw_rad: float = 0.0) -> Pose:
    return Pose.from_yaw(yaw_rad, [x_m, 0.0, 0.0])


UPSIDE_DOWN = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
UNLIKELY: dict[str, tuple[Callable[[int, Frame], Frame], str]] = {
    "microseconds": (
        lambda _, f: replace(
            f,
            stamp_ns=f.stamp_ns // 1000,
            truth=replace(f.truth, stamp_ns=f.stamp_ns // 1000),
            detections=replace(f.detections, stamp_ns=f.stamp_ns // 1000),
        ),
        "time steps that no sensor has: 23, .*the median is 0.0001 s",
    ),
    "upside down": (
        lambda i, f: replace(f, world_T_ego=pose(1.0 * i) @ UPSIDE_DOWN),
        "poses of a vehicle that lies: 24",
    ),
    "backwards": (
        lambda i, f: replace(f, world_T_ego=pose(1.0 * i, np.pi)),
        "vehicle drives backwards: 23",
    ),
    "a jump of the pose": (
        lambda i, f: replace(f, world_T_ego=pose(1.0 * i + (500.0 if i == 7 else 0.0))),
        "jumps of the vehicle: 2",
    ),
    "ego for global": (
        lambda i, f: replace(
            f,
            world_T_ego=Pose.from_yaw(0.0, [900.0 + i, 500.0, 0.0]),
            detections=moved(f.detections, [0.0, 0.0, 0.0]),
            truth=moved(f.truth, [900.0, 500.0, 0.0]),
        ),
        "detections far from the vehicle: 48",
    ),
    "headings turned round": (
        lambda _, f: replace(f, truth=replace(f.truth, yaw_rad=f.truth.yaw_rad + np.pi)),
        "headings against the motion: 48",
    ),
    "headings of another zero": (
        lambda _, f: replace(f, truth=replace(f.truth, yaw_rad=f.truth.yaw_rad + np.pi / 2)),
        "headings across the motion: 48",
    ),
    "one heading": (
        lambda _, f: replace(f, detections=replace(f.detections, yaw_rad=np.full(2, np.pi))),
        "detections of one heading: 48",
    ),
    "an object that jumps": (
        lambda _, f: replace(
            f, truth=replace(f.truth, velocity_mps=np.array([[7500.0, 0.0], [5.0, 0.0]]))
        ),
        "jumps of an object: 24",
    ),
    "another spelling": (
        lambda _, f: replace(f, detections=replace(f.detections, label=np.array(["Car", "car"]))),
        "of no class of the data set, left out: 24, .*found Car 24; classes car",
    ),
    "no class at all": (
        lambda _, f: replace(f, detections=replace(f.detections, label=np.array(["2", "2"]))),
        "left out: 48, .*found 2 48",
    ),
    "a detection twice": (
        lambda _, f: replace(f, detections=f.detections.select(np.array([0, 0, 1]))),
        "detections twice in one place: 24",
    ),
    "another class": (
        lambda i, f: replace(
            f, truth=replace(f.truth, label=np.array(["car", "car" if i % 2 else "pedestrian"]))
        ),
        "identities that change their class: 23",
    ),
    "empty boxes": (
        lambda _, f: replace(f, truth=replace(f.truth, num_points=np.zeros(2, int))),
        "annotations without a return: 48",
    ),
    "half the frames": (
        lambda i, f: replace(f, detections=f.detections.select(np.zeros(0, int))) if i < 12 else f,
        "key frames in a row without detections: 12",
    ),
}


@pytest.mark.parametrize("fault", UNLIKELY)
def test_what_is_unlikely_is_told(fault: str) -> None:
    change, message = UNLIKELY[fault]
    found = watched(change)
    assert any(re.search(message, text) for text in found), found


def test_a_detector_that_found_nothing_is_told() -> None:
    nothing = watched(lambda _, f: replace(f, detections=Objects.empty(f.stamp_ns)))
    assert len(nothing) == 1
    assert nothing[0].startswith(f"key frames without a detection: {FRAMES}")
    assert watched(lambda _, f: replace(f, detections=None)) == []  # no detector, no concern


def test_mirrored_points_leave_boxes_empty(written_roots) -> None:
    from mottrack.datasets.kitti.config import KittiConfig
    from mottrack.datasets.kitti.dataset import Kitti

    scene = Kitti(KittiConfig(root=written_roots["kitti"])).scene("0000")
    for mirrored in (False, True):
        watch = SceneWatch(scene)
        for index in range(len(scene)):
            sweep = scene.sweep(index)
            points = sweep.xyz_m * np.float32([1, -1 if mirrored else 1, 1])
            watch.add(scene.frame(index), replace(sweep, xyz_m=points))
        kinds = [concern.kind for concern in watch.concerns()]
        assert ("annotations that no point lies in" in kinds) is mirrored


def test_check_prints_warnings_and_strict_makes_them_faults(written_roots, tmp_path) -> None:
    import shutil

    root = tmp_path / "kitti"
    shutil.copytree(written_roots["kitti"], root)
    poses = root / "training/poses/0000.txt"
    lines = poses.read_text().splitlines()
    poses.write_text("\n".join([*lines, lines[-1]]) + "\n")
    labels = root / "training/label_02/0000.txt"
    labels.write_text(labels.read_text().replace(" Car ", " car "))
    command = ["check", str(root), "--workers", "1", "frames=10"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    assert "no fault found" in result.output
    assert "warning: poses of no frame: 1 in 1 scene" in result.output
    assert CliRunner().invoke(app, [*command, "--strict"]).exit_code == 3
