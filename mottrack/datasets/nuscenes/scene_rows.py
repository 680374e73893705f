"""Records and sweep files that one scene adds to a nuScenes data set."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from mottrack.core import Frame, InputError, Objects, Pose, Scene, Sweep, Truth
from mottrack.core.arrays import F64
from mottrack.core.storage import write_bytes
from mottrack.datasets.counting import counted_points
from mottrack.datasets.nuscenes.config import DETECTION_NAMES
from mottrack.datasets.nuscenes.scene import INTENSITY_MAX
from mottrack.datasets.nuscenes.static_rows import attribute_of, category_of, token_of
from mottrack.datasets.nuscenes.submission import box_geometry
from mottrack.datasets.nuscenes.visibility import visibilities
from mottrack.formats.nuscenes_records import CHANNEL
from mottrack.formats.rigid import quaternion_wxyz
from mottrack.formats.table_stream import Row

PITCH_RAD, ROLL_RAD = 0.02, -0.006
"""Tilt of the mounting, about that of nuScenes' calibrations."""
_EGO_R_LEVEL = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_PITCH = np.array(
    [
        [1.0, 0.0, 0.0],
        [0.0, np.cos(PITCH_RAD), -np.sin(PITCH_RAD)],
        [0.0, np.sin(PITCH_RAD), np.cos(PITCH_RAD)],
    ]
)
_ROLL = np.array(
    [
        [np.cos(ROLL_RAD), 0.0, np.sin(ROLL_RAD)],
        [0.0, 1.0, 0.0],
        [-np.sin(ROLL_RAD), 0.0, np.cos(ROLL_RAD)],
    ]
)
EGO_R_LIDAR = _EGO_R_LEVEL @ _PITCH @ _ROLL
"""nuScenes' LIDAR_TOP looks along its y axis, and stands a little askew."""


class SceneRows:
    """Collects what one scene adds to the tables; writes its sweeps on the way."""

    def __init__(self, name: str, root: Path) -> None:
        self._name, self._root = name, root
        self._samples: list[str] = []
        self._boxes: dict[int, list[Row]] = defaultdict(list)
        self._category: dict[int, str] = {}
        self.tables: dict[str, list[Row]] = defaultdict(list)
        self.detections: dict[str, list[Row]] = {}

    def add_all(self, scene: Scene) -> None:
        """Add every frame of a scene, then what refers to the whole of it."""
        waiting: list[Row] = []
        for index in range(len(scene)):
            frame = scene.frame(index)
            sweep = scene.sweep(index) if scene.has_sweeps else None
            waiting.append(self._sample_data(index, frame, sweep))
            if frame.is_key:
                self._add_key_frame(frame, sweep)
                # a sweep between key frames belongs to the next one
                self._assign(waiting, self._samples[-1])
                waiting = []
        if not self._samples:
            raise InputError("key frames", 0, f"at least one in scene {scene.name}")
        self._assign(waiting, self._samples[-1])
        self._finish()

    def _assign(self, waiting: list[Row], sample: str) -> None:
        self.tables["sample_data"].extend(row | {"sample_token": sample} for row in waiting)

    def _sample_data(self, index: int, frame: Frame, sweep: Sweep | None) -> Row:
        origin = np.zeros(3) if sweep is None else sweep.origin_m
        folder = "samples" if frame.is_key else "sweeps"
        stamp_us = _microseconds(frame)
        file = f"{folder}/{CHANNEL}/{self._name}__{CHANNEL}__{stamp_us}.pcd.bin"
        if sweep is not None:
            write_bytes(self._root / file, _points(sweep))
        token = token_of("sample_data", self._name, index)
        self.tables["ego_pose"].append(
            {"token": token, "timestamp": stamp_us, **_placed(frame.world_T_ego)}
        )
        return {
            "token": token,
            "ego_pose_token": token,
            "calibrated_sensor_token": self._calibration(origin),
            "timestamp": stamp_us,
            "fileformat": "pcd",
            "is_key_frame": frame.is_key,
            "height": 0,
            "width": 0,
            "filename": file,
        }

    def _calibration(self, origin_m: F64) -> str:
        token = token_of("calibrated_sensor", self._name, origin_m.tolist())
        if all(row["token"] != token for row in self.tables["calibrated_sensor"]):
            row = {
                "token": token,
                "sensor_token": token_of("sensor", CHANNEL),
                **_placed(Pose(EGO_R_LIDAR, origin_m)),
                "camera_intrinsic": [],
            }
            self.tables["calibrated_sensor"].append(row)
        return token

    def _add_key_frame(self, frame: Frame, sweep: Sweep | None) -> None:
        token = token_of("sample", self._name, len(self._samples))
        self._samples.append(token)
        self.tables["sample"].append(
            {
                "token": token,
                "timestamp": _microseconds(frame),
                "scene_token": token_of("scene", self._name),
            }
        )
        if frame.truth is not None:
            self._add_boxes(token, frame.truth, sweep)
        if frame.detections is not None:
            self.detections[token] = detection_rows(token, frame.detections)

    def _add_boxes(self, sample: str, truth: Truth, sweep: Sweep | None) -> None:
        points = counted_points(truth, sweep)
        visibility = visibilities(truth, sweep)
        geometry = box_geometry(truth)
        for i, identity in enumerate(truth.id.tolist()):
            category = self._category.setdefault(identity, category_of(str(truth.label[i])))
            attribute = attribute_of(category, float(np.hypot(*truth.velocity_mps[i])))
            row = {
                "token": token_of("annotation", sample, identity),
                "sample_token": sample,
                "instance_token": token_of("instance", self._name, identity),
                "visibility_token": visibility[i],
                "attribute_tokens": [token_of("attribute", attribute)] if attribute else [],
                **geometry[i],
                "num_lidar_pts": int(points[i]),
                "num_radar_pts": 0,
            }
            self._boxes[identity].append(row)

    def _finish(self) -> None:
        _chain(self.tables["sample"])
        _chain(self.tables["sample_data"])
        for identity, rows in self._boxes.items():
            _chain(rows)
            self.tables["sample_annotation"].extend(rows)
            self.tables["instance"].append(
                {
                    "token": rows[0]["instance_token"],
                    "category_token": token_of("category", self._category[identity]),
                    "nbr_annotations": len(rows),
                    "first_annotation_token": rows[0]["token"],
                    "last_annotation_token": rows[-1]["token"],
                }
            )
        self.tables["scene"].append(
            {
                "token": token_of("scene", self._name),
                "log_token": token_of("log", self._name),
                "nbr_samples": len(self._samples),
                "first_sample_token": self._samples[0],
                "last_sample_token": self._samples[-1],
                "name": self._name,
                "description": "written by mottrack",
            }
        )


def detection_rows(sample: str, found: Objects) -> list[Row]:
    """Return the boxes of one sample in the official detection format."""
    geometry = box_geometry(found)
    rows = []
    for i, label in enumerate(found.label.tolist()):
        if label in DETECTION_NAMES:
            rows.append(
                {
                    "sample_token": sample,
                    **geometry[i],
                    "velocity": _velocity(found, i),
                    "detection_name": label,
                    "detection_score": float(found.score[i]),
                    "attribute_name": "",
                }
            )
    return rows


def _velocity(found: Objects, index: int) -> list[float]:
    """Return NaN where no velocity was measured, as detectors write it: zero would say at rest."""
    if found.velocity is None or not found.velocity.valid[index]:
        return [float("nan")] * 2
    x, y = found.velocity.mean_mps[index].tolist()
    return [x, y]


def _chain(rows: list[Row]) -> None:
    """Link records in order by `prev` and `next`."""
    tokens = ["", *(row["token"] for row in rows), ""]
    for i, row in enumerate(rows):
        row["prev"], row["next"] = tokens[i], tokens[i + 2]


def _microseconds(frame: Frame) -> int:
    return round(frame.stamp_ns / 1000)


def _placed(pose: Pose) -> Row:
    return {
        "translation": pose.translation_m.tolist(),
        "rotation": quaternion_wxyz(pose.rotation).tolist(),
    }


def _points(sweep: Sweep) -> bytes:
    ego_T_lidar = Pose(EGO_R_LIDAR, sweep.origin_m)
    xyz_m = ego_T_lidar.inverse().apply(sweep.xyz_m)
    ring = np.zeros(len(sweep)) if sweep.ring is None else sweep.ring
    intensity = np.round(sweep.reflectance * INTENSITY_MAX)
    return np.column_stack([xyz_m, intensity, ring]).astype("<f4").tobytes()
