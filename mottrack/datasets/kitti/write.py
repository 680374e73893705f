"""Write any scenes as a KITTI tracking data set."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from mottrack.core import Boxes, Frame, Pose, Scene
from mottrack.core.arrays import I64
from mottrack.core.storage import write_bytes, write_text
from mottrack.datasets.kitti.boxes import (
    FIELD_OF_VIEW_RAD,
    PROJECTION,
    CameraBoxes,
    EgoBoxes,
    ego_to_camera,
    image_boxes,
)
from mottrack.datasets.kitti.labels import DETECTOR_TYPES

CAMERA_T_EGO = Pose(
    np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    np.array([-0.004, -0.076, -0.272]),
)
"""KITTI's mounting to the millimetre, its rotation rounded to the axes."""
_NEAREST_M = 1.0
"""Boxes centred nearer than this before the Velodyne are under the camera: not in its view."""
KIND_OF = {
    "car": "Car",
    "pedestrian": "Pedestrian",
    "cyclist": "Cyclist",
    "bicycle": "Cyclist",
    "motorcycle": "Cyclist",
    "truck": "Truck",
    "trailer": "Truck",
    "bus": "Truck",
}
"""Label to KITTI type; everything else is `Misc`, as in KITTI."""
DETECTIONS = "detections/pointrcnn"


def write_kitti(scenes: Iterable[Scene], root: Path) -> tuple[str, ...]:
    """Write `training/` and detections; return the names of the sequences, 0000, 0001, ...

    As in KITTI only what the camera sees is labelled, every frame is a key frame, and time is
    the frame's number: the scenes should have a constant rate. Boxes are rounded to 1e-6.
    """
    names = []
    for number, scene in enumerate(scenes):
        names.append(f"{number:04d}")
        _write_sequence(scene, root, names[-1])
    return tuple(names)


def _write_sequence(scene: Scene, root: Path, name: str) -> None:
    training = root / "training"
    labels: list[str] = []
    poses: list[str] = []
    detections: dict[str, list[str]] = {kind: [] for kind in DETECTOR_TYPES.values()}
    for index in range(len(scene)):
        frame = scene.frame(index)
        poses.append(_row((frame.world_T_ego @ CAMERA_T_EGO.inverse()).matrix[:3].ravel(), 12))
        labels.extend(_label_rows(index, frame))
        _add_detections(detections, index, frame)
        if scene.has_sweeps:
            sweep = scene.sweep(index)
            values = np.column_stack([sweep.xyz_m, sweep.reflectance]).astype("<f4")
            write_bytes(training / "velodyne" / name / f"{index:06d}.bin", values.tobytes())
    write_text(training / "calib" / f"{name}.txt", _calibration())
    write_text(training / "poses" / f"{name}.txt", _lines(poses))
    write_text(training / "label_02" / f"{name}.txt", _lines(labels))
    for kind, rows in detections.items():
        write_text(root / DETECTIONS / kind / f"{name}.txt", _lines(rows))


def _label_rows(number: int, frame: Frame) -> list[str]:
    if frame.truth is None:
        return []
    truth = frame.truth.select(_seen(frame.truth, frame))
    camera = _camera_boxes(truth, frame)
    image = image_boxes(camera)
    rows = []
    for i in range(len(truth)):
        kind = KIND_OF.get(str(truth.label[i]), "Misc")
        alpha = _alpha(camera, i)
        box = _row([*camera.size_hwl_m[i], *camera.bottom_m[i], camera.ry_rad[i]], 6)
        rows.append(f"{number} {truth.id[i]} {kind} 0 0 {alpha:.6f} {_row(image[i], 6)} {box}")
    return rows


def _add_detections(rows: dict[str, list[str]], number: int, frame: Frame) -> None:
    """Append the rows of a frame to those of each KITTI type."""
    if frame.detections is None:
        return
    found = frame.detections.select(_seen(frame.detections, frame))
    camera = _camera_boxes(found, frame)
    image = image_boxes(camera)
    numbers = {kind: number for number, kind in DETECTOR_TYPES.items()}
    for i in range(len(found)):
        kind = KIND_OF.get(str(found.label[i]), "Misc")
        if kind in numbers:
            box = [*camera.size_hwl_m[i], *camera.bottom_m[i], camera.ry_rad[i], _alpha(camera, i)]
            values = _row([*image[i], found.score[i], *box], 6).replace(" ", ",")
            rows[kind].append(f"{number},{numbers[kind]},{values}")


def _seen(boxes: Boxes, frame: Frame) -> I64:
    """Return the rows whose centre the camera sees."""
    centre_m = boxes.transformed(frame.world_T_ego.inverse(), "ego").centre_m
    azimuth = np.arctan2(centre_m[:, 1], centre_m[:, 0])
    return np.flatnonzero((np.abs(azimuth) < FIELD_OF_VIEW_RAD) & (centre_m[:, 0] > _NEAREST_M))


def _camera_boxes(boxes: Boxes, frame: Frame) -> CameraBoxes:
    ego = boxes.transformed(frame.world_T_ego.inverse(), "ego")
    ego_boxes = EgoBoxes(ego.centre_m, ego.size_m, ego.yaw_rad)
    return ego_to_camera(ego_boxes, CAMERA_T_EGO.inverse())


def _alpha(camera: CameraBoxes, index: int) -> float:
    """Return the heading relative to the ray to the object."""
    x, _, z = camera.bottom_m[index]
    return float(np.mod(camera.ry_rad[index] - np.arctan2(x, z) + np.pi, 2 * np.pi) - np.pi)


def _calibration() -> str:
    imu_T_velo = "1 0 0 -0.81 0 1 0 0.32 0 0 1 -0.8"
    lines = [f"P{i}: {_row(PROJECTION.ravel(), 12)}" for i in range(4)]
    lines.append(f"R_rect {_row(np.eye(3).ravel(), 12)}")
    lines.append(f"Tr_velo_cam {_row(CAMERA_T_EGO.matrix[:3].ravel(), 12)}")
    lines.append(f"Tr_imu_velo {imu_T_velo}")
    return _lines(lines)


def _row(values: Iterable[float], digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)


def _lines(rows: list[str]) -> str:
    return "".join(f"{row}\n" for row in rows)
